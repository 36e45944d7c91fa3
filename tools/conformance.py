"""Compare the parser with golden motion vectors: ``tools/conformance.py DIR``.

``DIR`` holds a ``MANIFEST.json`` with a list ``streams`` and, for each stream, a golden ``.npz``
in the layout of the project's corpus (arrays per record, per reference and per 4x4 cell). The
table says for every stream whether all compared arrays are equal; arrays of a golden that are not
compared are named once at the end. Files that the manifest calls ``corrupt`` must equal the golden
up to the unit that is damaged; then they may be refused, or read on where nothing shows the damage.
The exit code is 1 when anything else happens.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.errors import MvmatchError, UnsupportedError
from mvmatch.sources import open_video
from mvmatch.sources.av1 import Av1Source

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mvmatch._core import CodedFrame

# libaom's numbers of the specification's types wedge, diffwtd, average, intra and distance.
LIBAOM_COMPOUND_TYPE = np.array([2, 3, 0, -1, 1], np.int8)
# NEARMV, NEAR_NEARMV, NEAR_NEWMV, NEW_NEARMV.
NEAR_MODES = (14, 18, 21, 22)
BLOCK_WIDTH = np.array(
    [4, 4, 8, 8, 8, 16, 16, 16, 32, 32, 32, 64, 64, 64, 128, 128, 4, 16, 8, 32, 16, 64]
)
BLOCK_HEIGHT = np.array(
    [4, 8, 4, 8, 16, 8, 16, 32, 16, 32, 64, 32, 64, 128, 64, 128, 16, 4, 32, 8, 64, 16]
)
# Facts of the frame header that carry the same number in a golden and in the parser.
HEADER_FIELDS = {
    "f_frame_type": "frame_type",
    "f_show_frame": "show_frame",
    "f_showable_frame": "showable_frame",
    "f_order_hint": "order_hint",
    "f_upscaled_w": "upscaled_width",
    "f_frame_w": "frame_width",
    "f_frame_h": "frame_height",
    "f_render_w": "render_width",
    "f_render_h": "render_height",
    "f_superres_denom": "superres_denom",
    "f_mi_rows": "mi_rows",
    "f_mi_cols": "mi_cols",
    "f_base_q_idx": "base_q_idx",
    "f_refresh_frame_flags": "refresh_frame_flags",
    "f_primary_ref_frame": "primary_ref_frame",
    "f_error_resilient_mode": "error_resilient_mode",
    "f_seg_enabled": "segmentation_enabled",
    "f_tile_cols": "tile_cols",
    "f_tile_rows": "tile_rows",
    "f_bit_depth": "bit_depth",
    "f_monochrome": "mono_chrome",
    "f_subsampling_x": "subsampling_x",
    "f_subsampling_y": "subsampling_y",
}
INTER_HEADER_FIELDS = {
    "f_allow_high_precision_mv": "allow_high_precision_mv",
    "f_allow_ref_frame_mvs": "use_ref_frame_mvs",
}
REFERENCE_FIELDS = {
    "ref_slot": "ref_frame_idx",
    "ref_order_hint": "ref_order_hint",
    "ref_sign_bias": "ref_sign_bias",
    "gm_type": "gm_type",
    "gm_params": "gm_params",
}


def block_columns(frame: CodedFrame) -> dict[str, np.ndarray]:
    """Columns of a frame's blocks under a golden's names and with its neutral values."""
    b = frame.blocks()
    inter, compound = b["is_inter"].astype(bool), b["ref_frame"][:, 1] > 0
    interintra = inter & (b["ref_frame"][:, 1] == 0)
    copied = b["use_intrabc"].astype(bool)
    wedge = b["wedge_index"] + 16 * b["wedge_sign"].astype(np.int16)
    kind = LIBAOM_COMPOUND_TYPE[b["compound_type"]]
    mask = np.select([kind == 2, kind == 3], [wedge, b["mask_type"].astype(np.int16)], -1)
    filters = np.where(inter[:, None], b["interp_filter"].astype(np.int16), -1)
    cfl = b["uv_mode"] == 13
    warped = b["motion_mode"] == 2
    # libaom counts the entries behind NEAR from 0, the specification from 1.
    near = np.isin(b["y_mode"], NEAR_MODES)
    return {
        "blk_row": b["mi_row"],
        "blk_col": b["mi_col"],
        "bsize": b["size"],
        "partition": b["partition"],
        "is_inter": inter,
        "intrabc": copied,
        "mode": b["y_mode"],
        "uv_mode": np.where(inter, -1, np.where(b["has_chroma"], b["uv_mode"], 0).astype(np.int16)),
        "mv": b["mv"].reshape(-1, 2, 2),
        "ref_frame": b["ref_frame"],
        "skip": b["skip"],
        "skip_mode": b["skip_mode"],
        "motion_mode": b["motion_mode"],
        "num_proj_ref": np.where(warped, b["num_samples"], 0),
        "warp_invalid": warped & ~b["is_warp_valid"].astype(bool),
        "interintra_mode": np.where(interintra, b["interintra_mode"].astype(np.int16), -1),
        "interintra_wedge": np.where(
            interintra & b["wedge_interintra"].astype(bool), b["wedge_index"].astype(np.int16), -1
        ),
        "comp_type": np.where(compound, kind, -1),
        "comp_mask": np.where(compound, mask, -1),
        "comp_group_idx": b["comp_group_idx"],
        "compound_idx": np.where(compound, b["compound_idx"], 0),
        "ref_mv_idx": b["ref_mv_idx"] - near.astype(np.uint8),
        "filter_y": filters[:, 0],
        "filter_x": filters[:, 1],
        "segment_id": b["segment_id"],
        "qindex": b["q_index"],
        "delta_lf": b["delta_lf"],
        "palette_y": b["palette_size"][:, 0],
        "palette_uv": b["palette_size"][:, 1],
        "filter_intra": np.where(
            b["use_filter_intra"], b["filter_intra_mode"].astype(np.int16), -1
        ),
        "angle_y": b["angle_delta"][:, 0],
        "angle_uv": b["angle_delta"][:, 1],
        "cfl_signs": np.where(cfl, b["cfl_alpha_signs"].astype(np.int16), -1),
        "cfl_idx": b["cfl_alpha"].astype(np.int8),
    }


def block_of_cell(columns: dict[str, np.ndarray], rows: int, cols: int) -> np.ndarray:
    """(rows * cols,) index of the block that covers each 4x4 cell, in raster order; -1 for none."""
    owner = np.full((rows, cols), -1, np.int64)
    width, height = BLOCK_WIDTH[columns["bsize"]] // 4, BLOCK_HEIGHT[columns["bsize"]] // 4
    corners = zip(columns["blk_row"], columns["blk_col"], height, width, strict=True)
    for index, (row, col, high, wide) in enumerate(corners):
        owner[row : row + high, col : col + wide] = index
    return owner.ravel()


def compare_frame(frame: CodedFrame, golden: Any, record: int) -> Iterator[tuple[str, bool]]:
    """Names of compared arrays, each with whether it is equal in this record."""
    header = frame.header()
    is_shown_again = bool(golden["f_show_existing_frame"][record])
    yield "f_show_existing_frame", frame.show_existing_frame == is_shown_again
    yield "f_decode_idx", frame.decode_index == golden["f_decode_idx"][record]
    yield "f_temporal_id", frame.temporal_id == golden["f_temporal_id"][record]
    yield "f_spatial_id", frame.spatial_id == golden["f_spatial_id"][record]
    if is_shown_again or frame.show_existing_frame:
        for name in ("f_frame_type", "f_order_hint", "f_refresh_frame_flags"):
            yield name, int(header[HEADER_FIELDS[name]]) == golden[name][record]
        return
    is_inter = header["frame_type"] in (1, 3)
    fields = HEADER_FIELDS | (INTER_HEADER_FIELDS if is_inter else {})
    for name, field in fields.items():
        yield name, int(header[field]) == golden[name][record]
    if is_inter:
        for name, field in REFERENCE_FIELDS.items():
            yield name, np.array_equal(golden[name][record], np.array(header[field], np.int64))
        yield (
            "ref_decode_idx",
            np.array_equal(golden["ref_decode_idx"][record], frame.ref_decode_index),
        )
    stats = frame.coefficient_stats()
    yield "txb_stats", np.array_equal(golden["txb_stats"][record], stats.astype(np.int64))
    columns = block_columns(frame)
    cells = slice(golden["cell_off"][record], golden["cell_off"][record + 1])
    owner = block_of_cell(columns, header["mi_rows"], header["mi_cols"])
    yield "coverage", len(owner) == cells.stop - cells.start and bool(np.all(owner >= 0))
    for name, column in columns.items():
        values = column[owner].astype(np.int64)
        yield name, np.array_equal(golden[name][cells].astype(np.int64), values)


def frames_of(path: Path) -> Iterator[CodedFrame]:
    """Every frame of a file, through the door that users take."""
    with open_video(path) as video:
        assert isinstance(video, Av1Source)
        for frame, _ in video.coded_frames():
            yield frame


class Report:
    """What the streams have shown so far."""

    def __init__(self) -> None:
        self.compared: set[str] = set()
        self.known: set[str] = set()
        self.failures = 0

    def check(self, path: Path, golden_path: Path, what: str = "") -> tuple[int, str, str]:
        """Frames read, verdict, and what is wrong; ``what`` names the damage of a corrupt file."""
        golden = dict(np.load(golden_path))
        self.known |= set(golden)
        total, record, wrong = len(golden["f_rec"]), 0, dict[str, int]()
        try:
            for frame in frames_of(path):
                if record >= total:
                    wrong["records"] = record
                    break
                for name, is_equal in compare_frame(frame, golden, record):
                    self.compared.add(name)
                    if not is_equal:
                        wrong.setdefault(name, record)
                record += 1
        except UnsupportedError as error:
            return record, "unsupported" if not wrong else "DIFFERENT", str(error)
        except MvmatchError as error:
            if what and not wrong:
                return record, "refused", f"{what}: {type(error).__name__}"
            return record, "ERROR", f"{error}; {wrong}"
        if record != total and not what:
            wrong["records"] = record
        damaged_unit = re.search(r"TU (\d+)", what)
        if wrong and damaged_unit and min(wrong.values()) > int(damaged_unit[1]):
            return record, "read on", what
        detail = ", ".join(f"{name} from record {first}" for name, first in wrong.items())
        return record, "DIFFERENT" if wrong else "equal", detail


def files(directory: Path) -> Iterator[tuple[str, Path, str]]:
    """Files of a folder with their goldens, and what is damaged in them."""
    manifest = json.loads((directory / "MANIFEST.json").read_text())
    for stream in manifest["streams"]:
        yield stream["file"], directory / stream["golden"], ""
    for stream in manifest.get("containers", []):
        yield stream["file"], directory / f"{stream['of']}.golden.npz", ""
    for stream in manifest.get("corrupt", []):
        yield stream["file"], directory / f"{stream['of']}.golden.npz", stream["what"]


def main() -> int:
    """Print the table; 0 when nothing differs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("directory", type=Path, nargs="+")
    parser.add_argument("--only", default="", help="streams whose name contains this")
    parser.add_argument("--allow-unsupported", action="store_true")
    options = parser.parse_args()
    report, verdicts = Report(), dict[str, int]()
    print(f"{'stream':<36} {'records':>7}  result")
    for directory in options.directory:
        for name, golden, what in files(directory):
            if options.only not in name:
                continue
            frames, verdict, detail = report.check(directory / name, golden, what)
            verdicts[verdict] = verdicts.get(verdict, 0) + 1
            print(f"{name.removesuffix('.ivf'):<36} {frames:>7}  {verdict} {detail}".rstrip())
    skipped = sorted(report.known - report.compared - {"cell_off"})
    print("\n" + ", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items())))
    print(f"compared arrays ({len(report.compared)}): {', '.join(sorted(report.compared))}")
    print(f"NOT compared ({len(skipped)}): {', '.join(skipped)}")
    allowed = {"equal", "refused", "read on"} | (
        {"unsupported"} if options.allow_unsupported else set()
    )
    return 0 if verdicts and set(verdicts) <= allowed else 1


if __name__ == "__main__":
    sys.exit(main())
