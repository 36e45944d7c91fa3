"""Write the Rust tables of `av1-motion` from the text of the AV1 specification.

    python tools/generate_tables.py SPEC_DIR [OUT_DIR]

SPEC_DIR holds the specification's markdown chapters (`06.bitstream.syntax.md` and so on). Every
number in the generated files is read from there; this script holds names only. `rustfmt` keeps
its hands off the generated rows, so a table can be held against the printed page line by line.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path

OUT_DIR = Path(__file__).parent.parent / "crates" / "av1-motion" / "src" / "tables"
LINE_LENGTH = 100

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

OPERATORS = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.LShift: operator.lshift,
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
        shape = [self.evaluate(dimension) for dimension in table.dimensions]
        if math.prod(shape) != len(table.tokens):
            raise SystemExit(f"{table.name}: {len(table.tokens)} values for shape {shape}")
        return shape


def section_at(text: str, position: int, chapter: int) -> str:
    """Number of the section that contains `position`, counted from the headings before it."""
    counters = [chapter, 0, 0, 0, 0]
    for heading in HEADING.finditer(text, 0, position):
        level = len(heading[1]) - 2
        if level:
            counters[level] += 1
        counters[level + 1 :] = [0] * (len(counters) - level - 1)
    return ".".join(str(counter) for counter in counters if counter)


def rust_name(name: str) -> str:
    return name.upper()


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
        inner = textwrap.fill(
            ", ".join(values) + ",",
            LINE_LENGTH,
            initial_indent=pad + "    ",
            subsequent_indent=pad + "    ",
            break_long_words=False,
        )
        return f"{pad}[\n{inner}\n{pad}]"
    step = math.prod(shape[1:])
    parts = [
        rust_rows(values[i : i + step], shape[1:], indent + 4) for i in range(0, len(values), step)
    ]
    one_line = f"{pad}[{', '.join(part.strip() for part in parts)}]"
    if len(one_line) < LINE_LENGTH and "\n" not in one_line:
        return one_line
    if len(shape) == 2 and max(map(len, parts)) < LINE_LENGTH and "\n" not in "".join(parts):
        inner = textwrap.fill(
            "@".join(part.strip().replace(" ", "~") for part in parts).replace("@", ", ") + ",",
            LINE_LENGTH,
            initial_indent=pad + "    ",
            subsequent_indent=pad + "    ",
            break_long_words=False,
        ).replace("~", " ")
        return f"{pad}[\n{inner}\n{pad}]"
    return f"{pad}[\n" + ",\n".join(parts) + f",\n{pad}]"


class RustFile:
    """Collects the items of one generated module, and what they take from its siblings."""

    def __init__(self, spec: Specification, title: str, **homes: str) -> None:
        """`homes` maps a sibling module to the pattern of the constants that live there."""
        self.spec = spec
        self.title = textwrap.fill(
            title, LINE_LENGTH, initial_indent="//! ", subsequent_indent="//! "
        )
        self.homes = homes
        self.uses: dict[str, set[str]] = {home: set() for home in homes}
        self.own: set[str] = set()
        self.parts: list[str] = []

    def constants(self, element: str, names: list[str], offset: int = 0) -> None:
        """One `const` per name, under the section that defines the first of them."""
        for name in names:
            section, value = self.spec.sections[name], self.spec.constants[name] + offset
            self.own.add(name)
            self.parts.append(f"/// §{section}\npub(crate) const {name}: {element} = {value:_};")
        self.parts.append("")

    def value(self, token: str) -> str:
        """The constant's name where this file defines or may import it, else the number."""
        if token in self.own:
            return token
        for home, pattern in self.homes.items():
            if re.fullmatch(pattern, token):
                self.uses[home].add(token)
                return token
        return str(self.spec.evaluate(token))

    def table(self, name: str, element: str, *, never: str | None = None) -> None:
        """The table as printed; `never` replaces the -1 of entries that are never accessed."""
        table = self.spec.tables[name]
        values = [self.value(token) for token in table.tokens]
        if never is not None:
            values = [never if value == "-1" else value for value in values]
        self.array(name, table.section, values, self.spec.shape(table), element)

    def array(
        self, name: str, section: str, values: list[str], shape: list[int], element: str
    ) -> None:
        head = f"pub(crate) const {rust_name(name)}: {rust_type(shape, element)} ="
        rows = rust_rows(values, shape, 0)
        one_line = f"{head} {rows};"
        if "\n" not in rows and len(one_line) > LINE_LENGTH:
            one_line = f"{head}\n    {rows};"
        self.parts.append(f"/// §{section} `{name}`\n#[rustfmt::skip]\n{one_line}\n")

    def write(self, path: Path) -> None:
        note = "//!\n//! Generated from the AV1 specification by `tools/generate_tables.py`; do not edit."
        head = [self.title, note, ""]
        for home, names in self.uses.items():
            block = textwrap.fill(
                ", ".join(sorted(names)) + ",",
                LINE_LENGTH,
                initial_indent="    ",
                subsequent_indent="    ",
            )
            head.append(f"#[rustfmt::skip]\nuse super::{home}::{{\n{block}\n}};\n")
        path.write_text("\n".join(head + self.parts).rstrip() + "\n", encoding="utf-8")


def numbered(spec: Specification, pattern: str) -> list[str]:
    """Names of an enumeration's members, by value."""
    names = [name for name in spec.constants if re.fullmatch(pattern, name)]
    return sorted(names, key=spec.constants.__getitem__)


def block_size(spec: Specification, out: Path) -> None:
    file = RustFile(
        spec,
        "§6.10.4 Block sizes and partitions, and what follows from a block's size (§9.3).",
        tx_size=r"TX_\d+X\d+",
    )
    file.constants("u8", [*numbered(spec, r"BLOCK_\d+X\d+"), "BLOCK_INVALID"])
    file.constants("usize", ["BLOCK_SIZES"])
    file.constants("u8", numbered(spec, r"PARTITION_(?!CONTEXTS)\w+"))
    for name in ("Mi_Width_Log2", "Mi_Height_Log2", "Num_4x4_Blocks_Wide", "Num_4x4_Blocks_High"):
        file.table(name, "u8")
    for name, source in (("Block_Width", "Wide"), ("Block_Height", "High")):
        table = spec.tables[f"Num_4x4_Blocks_{source}"]
        values = [str(4 * int(token)) for token in table.tokens]
        file.array(name, table.section, values, [len(values)], "u8")
    for name in (
        "Size_Group",
        "Max_Tx_Size_Rect",
        "Max_Tx_Depth",
        "Partition_Subsize",
        "Subsampled_Size",
        "Wedge_Bits",
    ):
        file.table(name, "u8")
    file.write(out / "block_size.rs")


def tx_size(spec: Specification, out: Path) -> None:
    file = RustFile(spec, "§6.10.16 Transform sizes and what follows from them (§9.3).")
    file.constants("u8", numbered(spec, r"TX_\d+X\d+"))
    file.constants("usize", ["TX_SIZES", "TX_SIZES_ALL"])
    for name in (
        "Split_Tx_Size",
        "Tx_Size_Sqr",
        "Tx_Size_Sqr_Up",
        "Tx_Width",
        "Tx_Height",
        "Tx_Width_Log2",
        "Tx_Height_Log2",
        "Adjusted_Tx_Size",
    ):
        file.table(name, "u8")
    file.write(out / "tx_size.rs")


def tx_type(spec: Specification, out: Path) -> None:
    file = RustFile(
        spec,
        "§5.11.40, §5.11.47, §9.3 Which transform types a mode implies and a set contains.",
        symbols=r"[A-Z]*DCT[A-Z_]*|[A-Z]*ADST[A-Z_]*|IDTX|[VH]_\w+",
    )
    for name in (
        "Mode_To_Txfm",
        "Tx_Type_In_Set_Intra",
        "Tx_Type_In_Set_Inter",
        "Tx_Type_Intra_Inv_Set1",
        "Tx_Type_Intra_Inv_Set2",
        "Tx_Type_Inter_Inv_Set1",
        "Tx_Type_Inter_Inv_Set2",
        "Tx_Type_Inter_Inv_Set3",
    ):
        file.table(name, "u8")
    file.write(out / "tx_type.rs")


def contexts(spec: Specification, out: Path) -> None:
    file = RustFile(
        spec,
        "§8.3.2, §9.3 Tables that choose the CDF of a syntax element.",
        symbols=r"[A-Z0-9]+_PRED",
    )
    for name in (
        "Intra_Mode_Context",
        "Compound_Mode_Ctx_Map",
        "Filter_Intra_Mode_To_Intra_Dir",
        "Sig_Ref_Diff_Offset",
        "Coeff_Base_Ctx_Offset",
        "Coeff_Base_Pos_Ctx_Offset",
        "Mag_Ref_Offset_With_Tx_Class",
    ):
        file.table(name, "u8")
    file.parts.append(
        "// The specification prints -1 where a hash cannot occur; 255 here, so that"
        " a use would be\n// out of bounds."
    )
    file.table("Palette_Color_Context", "u8", never="255")
    file.table("Palette_Color_Hash_Multipliers", "u8")
    file.write(out / "contexts.rs")


def arithmetic(spec: Specification, out: Path) -> None:
    file = RustFile(
        spec,
        "§7.9.3, §7.11.3.7 Reciprocals in fixed point; §5.11.57, §5.11.58 ranges"
        " of loop restoration coefficients.",
    )
    file.table("Div_Mult", "u16")
    file.table("Div_Lut", "u16")
    for name in (
        "Wiener_Taps_Mid",
        "Wiener_Taps_Min",
        "Wiener_Taps_Max",
        "Wiener_Taps_K",
        "Sgrproj_Xqd_Mid",
        "Sgrproj_Xqd_Min",
        "Sgrproj_Xqd_Max",
    ):
        file.table(name, "i32")
    file.write(out / "arithmetic.rs")


SYMBOLS: list[tuple[str, list[str]]] = [
    ("u8", [r"[DV]\d*_PRED|H_PRED|D\d+_PRED|SMOOTH\w*_PRED|PAETH_PRED|DC_PRED|UV_CFL_PRED"]),
    ("u8", [r"FILTER_\w+_PRED"]),
    ("u8", [r"II_\w+_PRED"]),
    ("u8", ["SIMPLE|OBMC|LOCALWARP"]),
    ("u8", [r"COMPOUND_(WEDGE|DIFFWTD|AVERAGE|INTRA|DISTANCE)"]),
    ("u8", [r"EIGHTTAP\w*|BILINEAR|SWITCHABLE"]),
    ("i8", [r"NONE|INTRA_FRAME|(LAST|LAST2|LAST3|GOLDEN|BWDREF|ALTREF2|ALTREF)_FRAME"]),
    ("u8", [r"(SINGLE|COMPOUND|UNIDIR_COMP|BIDIR_COMP)_REFERENCE"]),
    ("u8", [r"MV_JOINT_\w+"]),
    ("u8", [r"CFL_SIGN_\w+"]),
    ("u8", [r"RESTORE_\w+"]),
    ("u8", [r"TX_SET_(DCTONLY|INTRA_\d|INTER_\d)"]),
]

# §3: the constants that the parser computes with, by the type it computes in.
SECTION_3: list[tuple[str, str]] = [
    (
        "u8",
        "DCT_DCT ADST_DCT DCT_ADST ADST_ADST FLIPADST_DCT DCT_FLIPADST FLIPADST_FLIPADST"
        " ADST_FLIPADST FLIPADST_ADST IDTX V_DCT H_DCT V_ADST H_ADST V_FLIPADST H_FLIPADST",
    ),
    ("u8", "TX_CLASS_2D TX_CLASS_HORIZ TX_CLASS_VERT"),
    ("u8", "IDENTITY TRANSLATION ROTZOOM AFFINE"),
    (
        "u8",
        "PRIMARY_REF_NONE MAX_ANGLE_DELTA DELTA_Q_SMALL DELTA_LF_SMALL MAX_LOOP_FILTER"
        " MAX_VARTX_DEPTH MI_SIZE MI_SIZE_LOG2",
    ),
    (
        "usize",
        "REFS_PER_FRAME TOTAL_REFS_PER_FRAME NUM_REF_FRAMES MAX_SEGMENTS SEG_LVL_ALT_Q"
        " SEG_LVL_ALT_LF_Y_V SEG_LVL_REF_FRAME SEG_LVL_SKIP SEG_LVL_GLOBALMV SEG_LVL_MAX"
        " FRAME_LF_COUNT MV_CONTEXTS MV_INTRABC_CONTEXT COMP_NEWMV_CTXS PALETTE_COLORS"
        " PALETTE_NUM_NEIGHBORS TX_TYPES INTRA_MODES TX_SET_TYPES_INTRA TX_SET_TYPES_INTER"
        " MAX_REF_MV_STACK_SIZE MFMV_STACK_SIZE LEAST_SQUARES_SAMPLES_MAX"
        " SIG_COEF_CONTEXTS SIG_COEF_CONTEXTS_2D SIG_COEF_CONTEXTS_EOB"
        " SIG_REF_DIFF_OFFSET_NUM BR_CDF_SIZE COEFF_CDF_Q_CTXS",
    ),
    (
        "u32",
        "NUM_BASE_LEVELS COEFF_BASE_RANGE EC_PROB_SHIFT EC_MIN_PROB SUPERRES_NUM"
        " SGRPROJ_PARAMS_BITS SGRPROJ_PRJ_SUBEXP_K SGRPROJ_PRJ_BITS RESTORATION_TILESIZE_MAX"
        " REF_CAT_LEVEL",
    ),
    (
        "i32",
        "MV_BORDER REFMVS_LIMIT MAX_FRAME_DISTANCE MAX_OFFSET_WIDTH MAX_OFFSET_HEIGHT"
        " INTRABC_DELAY_PIXELS INTRABC_DELAY_SB64 LS_MV_MAX WARPEDMODEL_PREC_BITS"
        " WARPEDMODEL_TRANS_CLAMP WARPEDMODEL_NONDIAGAFFINE_CLAMP WARP_PARAM_REDUCE_BITS"
        " DIV_LUT_BITS DIV_LUT_PREC_BITS DIV_LUT_NUM",
    ),
]


def symbols(spec: Specification, out: Path) -> None:
    file = RustFile(spec, "§3, §6.10 Named constants of the specification, grouped by meaning.")
    for element, patterns in SYMBOLS:
        for pattern in patterns:
            names = numbered(spec, pattern)
            if not names:
                raise SystemExit(f"no constant matches {pattern}")
            file.constants(element, names)
    file.parts.append(
        "// §6.10.22 prints the inter modes as 14 to 25, leaving 13 to UV_CFL_PRED. Nothing computes"
        "\n// with their distance from the intra modes; numbered from 13 here, as decoders print them."
    )
    file.constants("u8", numbered(spec, r"(NEAR|NEW|GLOBAL)\w*MV"), offset=-1)
    for element, names in SECTION_3:
        file.constants(element, names.split())
    file.write(out / "symbols.rs")


def default_cdfs(spec: Specification, out: Path) -> None:
    tables = [name for name in spec.tables if re.fullmatch(r"Default_\w+_Cdf", name)]
    of_coefficients = {
        name for name in tables if spec.tables[name].dimensions[0].strip() == "COEFF_CDF_Q_CTXS"
    }
    for stem, title, chosen in (
        (
            "default_cdfs",
            "modes, motion and sizes",
            [name for name in tables if name not in of_coefficients],
        ),
        (
            "default_coef_cdfs",
            "transform coefficients, by quantiser class",
            [name for name in tables if name in of_coefficients],
        ),
    ):
        file = RustFile(spec, f"§9.4 Default CDFs of {title}, as printed.")
        for name in chosen:
            file.table(name, "u16")
        file.parts.insert(
            0, '#![allow(clippy::large_const_arrays, reason = "read by const fn only")]\n'
        )
        file.write(out / f"{stem}.rs")


def main() -> None:
    if len(sys.argv) not in (2, 3):
        raise SystemExit(__doc__)
    spec = Specification(Path(sys.argv[1]))
    out = Path(sys.argv[2]) if len(sys.argv) == 3 else OUT_DIR
    out.mkdir(parents=True, exist_ok=True)
    for write in (block_size, tx_size, tx_type, contexts, arithmetic, symbols, default_cdfs):
        write(spec, out)


if __name__ == "__main__":
    main()
