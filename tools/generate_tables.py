"""Write the Rust tables of `av1-motion` from the text of the AV1 specification.

    python tools/generate_tables.py SPEC_DIR [OUT_DIR]

SPEC_DIR holds the specification's markdown chapters (`06.bitstream.syntax.md` and so on). Every
number in the generated files is read from there; this script holds names only. `rustfmt` keeps
its hands off the generated rows, so a table can be held against the printed page line by line.
"""

from __future__ import annotations

import argparse
import ast
import math
import operator
import re
import textwrap
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

OUT_DIR = Path(__file__).parent.parent / "crates" / "av1-motion" / "src" / "tables"
LINE_LENGTH = 100
NOTE = """//!
//! Generated from the AV1 specification by `tools/generate_tables.py`; do not edit.
"""
ALLOW_LARGE = '#![allow(clippy::large_const_arrays, reason = "read by const fn only")]\n'

# File stem of a chapter -> its number in the published edition.
CHAPTERS = {
    "03.symbols": 3,
    "06.bitstream.syntax": 5,
    "07.bitstream.semantics": 6,
    "08.decoding.process": 7,
    "09.parsing.process": 8,
    "10.additional.tables": 9,
}

TABLE_HEAD = re.compile(r"^ *([A-Z]\w*) *((?:\[[^\]=]*\] *)+)=\s*\{", re.MULTILINE)
HEADING = re.compile(r"^(#{2,6}) ", re.MULTILINE)
SYMBOL_ROW = re.compile(r"^\| *`(\w+)` *\| *(.+?) *\|", re.MULTILINE)
VALUE_ROW = re.compile(r"^\|(?:[^|]*\|)? *(-?\d+) *\| *([A-Z][A-Z0-9_]+) *(?:$|[|(])", re.MULTILINE)

OPERATORS: dict[type[ast.operator], Callable[[int, int], int]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.LShift: lambda a, b: a << b,
}


@dataclass(frozen=True)
class Table:
    """One constant lookup table as printed: dimensions as expressions, values as tokens."""

    name: str
    section: str
    dimensions: list[str]
    tokens: list[str]


class Specification:
    """Named constants and lookup tables of all chapters."""

    def __init__(self, folder: Path) -> None:
        self.constants: dict[str, int] = {}
        self.sections: dict[str, str] = {}
        self.tables: dict[str, Table] = {}
        for stem, number in CHAPTERS.items():
            text = (folder / f"{stem}.md").read_text(encoding="utf-8").replace("\\<", "<")
            self._read_constants(text, number)
            self._read_tables(text, number)
        for name, source in (("Block_Width", "Wide"), ("Block_Height", "High")):
            table = self.tables[f"Num_4x4_Blocks_{source}"]  # §9.3 defines it by this product
            tokens = [f"4 * {token}" for token in table.tokens]
            self.tables[name] = replace(table, name=name, tokens=tokens)
        table = self.tables["Palette_Color_Context"]  # -1 stands for "never accessed"
        tokens = ["255" if token == "-1" else token for token in table.tokens]
        self.tables[table.name] = replace(table, tokens=tokens)
        for name in self.constants:
            if re.fullmatch(r"(NEAR|NEW|GLOBAL)\w*MV", name):
                self.constants[name] -= 1  # see the title of `symbols`

    def _read_constants(self, text: str, chapter: int) -> None:
        rows = [(m, m[1], m[2]) for m in SYMBOL_ROW.finditer(text) if chapter == 3]
        if chapter == 6:
            rows += [(m, m[2], m[1]) for m in VALUE_ROW.finditer(text)]
        for match, name, expression in rows:
            value = self.evaluate(expression)
            if text[match.start() : match.end()].count("|") > 2 and name.startswith("CFL_SIGN_"):
                continue  # a table of pairs of signs, not the definition of the signs
            if self.constants.setdefault(name, value) != value:
                raise SystemExit(f"{name} is {self.constants[name]} and {value}")
            self.sections.setdefault(name, section_at(text, match.start(), chapter))

    def _read_tables(self, text: str, chapter: int) -> None:
        for match in TABLE_HEAD.finditer(text):
            if not (chapter != 7 or match[1] in ("Div_Lut", "Div_Mult")):
                continue  # chapter 7 mixes tables with pixel processes nobody needs here
            depth, end = 1, match.end()
            while depth:
                depth += {"{": 1, "}": -1}.get(text[end], 0)
                end += 1
            body = re.sub(r"//.*", "", text[match.end() : end - 1])
            # §9.3 Split_Tx_Size lacks one comma at a line's end.
            body = re.sub(r"(\w)\s*\n\s*(\w)", r"\1, \2", body)
            tokens = [token.strip() for token in re.split(r"[{},]", body)]
            self.tables[match[1]] = Table(
                match[1],
                section_at(text, match.start(), chapter),
                re.findall(r"\[([^\]]*)\]", match[2]),
                [token for token in tokens if token],
            )

    def evaluate(self, expression: str) -> int:
        """Value of an integer expression over the constants known so far."""

        def visit(node: ast.expr) -> int:
            match node:
                case ast.Constant(value=int(value)):
                    return value
                case ast.Name(id=name):
                    return self.constants[name]
                case ast.UnaryOp(op=ast.USub(), operand=operand):
                    return -visit(operand)
                case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
                    return OPERATORS[type(op)](visit(left), visit(right))
                case _:
                    raise SystemExit(f"cannot evaluate {expression!r}")

        return visit(ast.parse(expression.strip(), mode="eval").body)

    def shape(self, table: Table) -> list[int]:
        """Evaluate the printed dimensions and check that the values fill them."""
        shape = [self.evaluate(dimension) for dimension in table.dimensions]
        if math.prod(shape) != len(table.tokens):
            raise SystemExit(f"{table.name}: {len(table.tokens)} values for shape {shape}")
        return shape


def section_at(text: str, position: int, chapter: int) -> str:
    """Count the headings before `position`: the number of the section that contains it."""
    counters = [chapter, 0, 0, 0, 0]
    for heading in HEADING.finditer(text, 0, position):
        level = len(heading[1]) - 2
        if level:
            counters[level] += 1
        counters[level + 1 :] = [0] * (len(counters) - level - 1)
    return ".".join(str(counter) for counter in counters if counter)


def rust_type(shape: list[int], element: str) -> str:
    for size in reversed(shape):
        element = f"[{element}; {size}]"
    return element


def rust_rows(values: list[str], shape: list[int], indent: int) -> str:
    """Nested array literal; innermost rows are filled up to the line length."""
    pad = " " * indent
    if len(shape) == 1:
        flat = f"{pad}[{', '.join(values)}]"
        if len(flat) < LINE_LENGTH:
            return flat
        inner = wrapped(", ".join(values) + ",", pad + "    ")
        return f"{pad}[\n{inner}\n{pad}]"
    step = math.prod(shape[1:])
    parts = [
        rust_rows(values[i : i + step], shape[1:], indent + 4) for i in range(0, len(values), step)
    ]
    one_line = f"{pad}[{', '.join(part.strip() for part in parts)}]"
    if len(one_line) < LINE_LENGTH and "\n" not in one_line:
        return one_line
    if len(shape) == 2 and max(map(len, parts)) < LINE_LENGTH and "\n" not in "".join(parts):
        kept = ["~".join(part.split()) for part in parts]
        inner = wrapped(", ".join(kept) + ",", pad + "    ").replace("~", " ")
        return f"{pad}[\n{inner}\n{pad}]"
    return f"{pad}[\n" + ",\n".join(parts) + f",\n{pad}]"


class RustFile:
    """Collects the items of one generated module, and what they take from its siblings."""

    def __init__(self, spec: Specification) -> None:
        self.spec = spec
        self.title = ""
        self.homes: dict[str, str] = {}
        self.uses: dict[str, set[str]] = {}
        self.own: set[str] = set()
        self.parts: list[str] = []

    def items(self, kind: str, element: str, patterns: list[str]) -> None:
        """Add the constants or tables that match, in the order of the patterns."""
        source = self.spec.constants if kind == "const" else self.spec.tables
        for pattern in patterns:
            names = [name for name in source if re.fullmatch(pattern, name)]
            if not names:
                raise SystemExit(f"nothing in the specification is called {pattern}")
            if kind == "table":
                for name in names:
                    self._table(self.spec.tables[name], element)
                continue
            for name in sorted(names, key=self.spec.constants.__getitem__):
                self.own.add(name)
                item = f"pub(crate) const {name}: {element} = {self.spec.constants[name]:_};"
                self.parts.append(f"/// §{self.spec.sections[name]}\n{item}")
        if kind == "const":
            self.parts.append("")

    def _value(self, token: str) -> str:
        """Give the constant's name where this file may use it, else its number."""
        if token in self.own:
            return token
        for home, pattern in self.homes.items():
            if re.fullmatch(pattern, token):
                self.uses.setdefault(home, set()).add(token)
                return token
        return str(self.spec.evaluate(token))

    def _table(self, table: Table, element: str) -> None:
        shape = self.spec.shape(table)
        values = [self._value(token) for token in table.tokens]
        head = f"pub(crate) const {table.name.upper()}: {rust_type(shape, element)} ="
        rows = rust_rows(values, shape, 0)
        item = f"{head} {rows};"
        if "\n" not in rows and len(item) > LINE_LENGTH:
            item = f"{head}\n    {rows};"
        self.parts.append(f"/// §{table.section} `{table.name}`\n#[rustfmt::skip]\n{item}\n")

    def write(self, path: Path) -> None:
        """Write title, imports and items, in this order."""
        head = [wrapped(self.title.strip(), "//! "), NOTE]
        if path.stem.endswith("_cdfs"):
            head.append(ALLOW_LARGE)
        for home, names in self.uses.items():
            block = wrapped(", ".join(sorted(names)) + ",", "    ")
            head.append(f"#[rustfmt::skip]\nuse super::{home}::{{\n{block}\n}};\n")
        path.write_text("\n".join(head + self.parts).rstrip() + "\n", encoding="utf-8")


def wrapped(text: str, indent: str) -> str:
    """Fill `text` up to the line length, each line after `indent`."""
    return textwrap.fill(
        text,
        LINE_LENGTH,
        initial_indent=indent,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


# What goes where. `const` lines hold names or patterns of constants, which come sorted by value;
# `table` lines hold names of tables; both begin with the element type the parser computes in.
# A `from` line lets a module name the constants of a sibling that match a pattern.
MODULES = r"""
module block_size
title §6.10.4 Block sizes and partitions, and what follows from a block's size (§9.3).
from tx_size TX_\d+X\d+
const u8 BLOCK_\d+X\d+ BLOCK_INVALID
const usize BLOCK_SIZES
const u8 PARTITION_(?!CONTEXTS)\w+
table u8 Mi_Width_Log2 Mi_Height_Log2 Num_4x4_Blocks_Wide Num_4x4_Blocks_High
table u8 Block_Width Block_Height Size_Group Max_Tx_Size_Rect Max_Tx_Depth
table u8 Partition_Subsize Subsampled_Size Wedge_Bits

module tx_size
title §6.10.16 Transform sizes and what follows from them (§9.3).
const u8 TX_\d+X\d+
const usize TX_SIZES TX_SIZES_ALL
table u8 Split_Tx_Size Tx_Size_Sqr Tx_Size_Sqr_Up Tx_Width Tx_Height Tx_Width_Log2
table u8 Tx_Height_Log2 Adjusted_Tx_Size

module tx_type
title §5.11.40, §5.11.47, §9.3 Which transform types a mode implies and a set contains.
from symbols ((FLIP)?ADST|DCT|[VH])_((FLIP)?ADST|DCT)|IDTX
table u8 Mode_To_Txfm Tx_Type_In_Set_Intra Tx_Type_In_Set_Inter
table u8 Tx_Type_Intra_Inv_Set1 Tx_Type_Intra_Inv_Set2
table u8 Tx_Type_Inter_Inv_Set1 Tx_Type_Inter_Inv_Set2 Tx_Type_Inter_Inv_Set3

module contexts
title §8.3.2, §9.3 Tables that choose the CDF of a syntax element.
title `Palette_Color_Context` has 255 where -1 is printed for a hash that cannot occur.
from symbols [A-Z0-9]+_PRED
table u8 Intra_Mode_Context Compound_Mode_Ctx_Map Filter_Intra_Mode_To_Intra_Dir
table u8 Sig_Ref_Diff_Offset Coeff_Base_Ctx_Offset Coeff_Base_Pos_Ctx_Offset
table u8 Mag_Ref_Offset_With_Tx_Class Palette_Color_Context Palette_Color_Hash_Multipliers

module arithmetic
title §7.9.3, §7.11.3.7 Reciprocals in fixed point;
title §5.11.57, §5.11.58 ranges of loop restoration coefficients.
table u16 Div_Mult Div_Lut
table i32 Wiener_Taps_Mid Wiener_Taps_Min Wiener_Taps_Max Wiener_Taps_K
table i32 Sgrproj_Xqd_Mid Sgrproj_Xqd_Min Sgrproj_Xqd_Max

module symbols
title §3, §6.10 Named constants of the specification, grouped by meaning.
title The inter modes are printed as 14 to 25, leaving 13 to `UV_CFL_PRED`; nothing computes with
title their distance from the intra modes, and here they count from 13, as decoders print them.
const u8 DC_PRED V_PRED H_PRED D\d+_PRED SMOOTH\w*_PRED PAETH_PRED UV_CFL_PRED
const u8 (NEAR|NEW|GLOBAL)\w*MV
const u8 FILTER_\w+_PRED
const u8 II_\w+_PRED
const u8 SIMPLE OBMC LOCALWARP
const u8 COMPOUND_(WEDGE|DIFFWTD|AVERAGE|INTRA|DISTANCE)
const u8 EIGHTTAP\w* BILINEAR SWITCHABLE
const i8 NONE INTRA_FRAME (LAST|LAST2|LAST3|GOLDEN|BWDREF|ALTREF2|ALTREF)_FRAME
const u8 SINGLE_REFERENCE COMPOUND_REFERENCE UNIDIR_COMP_REFERENCE BIDIR_COMP_REFERENCE
const u8 MV_JOINT_\w+
const u8 CFL_SIGN_\w+
const u8 RESTORE_\w+
const u8 TX_SET_DCTONLY TX_SET_INTRA_\d TX_SET_INTER_\d
const u8 (DCT|ADST|FLIPADST)_(DCT|ADST|FLIPADST) IDTX [VH]_(DCT|ADST|FLIPADST)
const u8 TX_CLASS_\w+
const u8 IDENTITY TRANSLATION ROTZOOM AFFINE
const u8 PRIMARY_REF_NONE MAX_ANGLE_DELTA DELTA_Q_SMALL DELTA_LF_SMALL MAX_LOOP_FILTER
const u8 MAX_VARTX_DEPTH MI_SIZE MI_SIZE_LOG2
const usize REFS_PER_FRAME TOTAL_REFS_PER_FRAME NUM_REF_FRAMES
const usize MAX_SEGMENTS SEG_LVL_\w+ FRAME_LF_COUNT
const usize MV_CONTEXTS MV_INTRABC_CONTEXT COMP_NEWMV_CTXS MAX_REF_MV_STACK_SIZE MFMV_STACK_SIZE
const usize LEAST_SQUARES_SAMPLES_MAX PALETTE_COLORS PALETTE_NUM_NEIGHBORS
const usize TX_TYPES INTRA_MODES TX_SET_TYPES_INTRA TX_SET_TYPES_INTER
const usize SIG_COEF_CONTEXTS\w* SIG_REF_DIFF_OFFSET_NUM BR_CDF_SIZE COEFF_CDF_Q_CTXS
const u32 NUM_BASE_LEVELS COEFF_BASE_RANGE EC_PROB_SHIFT EC_MIN_PROB REF_CAT_LEVEL SUPERRES_NUM
const u32 SGRPROJ_PARAMS_BITS SGRPROJ_PRJ_SUBEXP_K SGRPROJ_PRJ_BITS RESTORATION_TILESIZE_MAX
const i32 MV_BORDER REFMVS_LIMIT MAX_FRAME_DISTANCE MAX_OFFSET_WIDTH MAX_OFFSET_HEIGHT
const i32 INTRABC_DELAY_PIXELS INTRABC_DELAY_SB64 LS_MV_MAX WARPEDMODEL_PREC_BITS
const i32 WARPEDMODEL_TRANS_CLAMP WARPEDMODEL_NONDIAGAFFINE_CLAMP WARP_PARAM_REDUCE_BITS
const i32 DIV_LUT_BITS DIV_LUT_PREC_BITS DIV_LUT_NUM

module default_cdfs
title §9.4 Default CDFs of modes, motion and sizes, as printed.
table u16 Default_(?!Txb_Skip|Eob|Dc_Sign|Coeff)\w+_Cdf

module default_coef_cdfs
title §9.4 Default CDFs of transform coefficients by quantiser class, as printed.
table u16 Default_(Txb_Skip|Eob|Dc_Sign|Coeff)\w*_Cdf
"""


def write_module(spec: Specification, out: Path, description: str) -> None:
    """Write the file that one paragraph of `MODULES` describes."""
    file = RustFile(spec)
    name, *lines = description.splitlines()
    for line in lines:
        key, rest = line.split(maxsplit=1)
        if key == "title":
            file.title += f" {rest}"
        elif key == "from":
            home, pattern = rest.split()
            file.homes[home] = pattern
        else:
            element, *patterns = rest.split()
            file.items(key, element, patterns)
    file.write(out / f"{name.removeprefix('module ')}.rs")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("spec", type=Path, help="folder of the specification's markdown chapters")
    parser.add_argument("out", type=Path, nargs="?", default=OUT_DIR, help="default: %(default)s")
    arguments = parser.parse_args()
    spec = Specification(arguments.spec)
    arguments.out.mkdir(parents=True, exist_ok=True)
    for description in MODULES.strip().split("\n\n"):
        write_module(spec, arguments.out, description)


if __name__ == "__main__":
    main()
