"""Condense golden motion vectors to digests: ``golden_digests.py STREAMS GOLDENS > expected.txt``.

``STREAMS`` is a folder of IVF files, ``GOLDENS`` one with a ``.golden.npz`` for each (libaom's
inspection hook). A line holds stream, record, decode index, order hint, number of blocks and the
digest of everything compared: ``h = h * 0x100000001B3 + value`` modulo 2^64 over the values that
``crates/av1-motion/tests/golden.rs`` lists in the same order.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

# Columns of a block in digest order; some are several numbers wide.
CELL_COLUMNS = [
    *("blk_row", "blk_col", "bsize", "partition", "is_inter", "intrabc", "mode", "uv_mode", "mv"),
    *("ref_frame", "skip", "skip_mode", "motion_mode", "num_proj_ref", "warp_invalid"),
    *("interintra_mode", "interintra_wedge", "comp_type", "comp_mask", "comp_group_idx"),
    *("compound_idx", "ref_mv_idx", "filter_y", "filter_x", "segment_id", "qindex", "delta_lf"),
    *("palette_y", "palette_uv", "filter_intra", "angle_y", "angle_uv", "cfl_signs", "cfl_idx"),
]
PRIME = np.uint64(0x100000001B3)


def digest(values: np.ndarray) -> int:
    """Polynomial hash of integers, modulo 2^64."""
    words = values.astype(np.int64).view(np.uint64)
    powers = np.multiply.accumulate(np.r_[np.uint64(1), np.full(max(len(words) - 1, 0), PRIME)])
    return int(np.sum(words * powers[::-1], dtype=np.uint64)) if len(words) else 0


def record_line(golden: dict[str, Any], record: int) -> str:
    """One line of the expected file, without the stream's name."""
    facts = [int(golden[f"f_{name}"][record]) for name in ("decode_idx", "order_hint")]
    if golden["f_show_existing_frame"][record]:
        return f"{record} {facts[0]} {facts[1]} shown -"
    cells = slice(golden["cell_off"][record], golden["cell_off"][record + 1])
    rows, cols = int(golden["f_mi_rows"][record]), int(golden["f_mi_cols"][record])
    row, col = np.divmod(np.arange(rows * cols), cols)
    is_origin = (golden["blk_row"][cells] == row) & (golden["blk_col"][cells] == col)
    columns = [
        golden[name][cells][is_origin].reshape(int(is_origin.sum()), -1).astype(np.int64)
        for name in CELL_COLUMNS
    ]
    frame = np.r_[golden["ref_decode_idx"][record], golden["txb_stats"][record].ravel()]
    values = np.r_[np.hstack(columns).ravel(), frame.astype(np.int64)]
    return f"{record} {facts[0]} {facts[1]} {int(is_origin.sum())} {digest(values):016x}"


def main() -> None:
    """Write the lines of all streams to standard output."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("streams", type=Path)
    parser.add_argument("goldens", type=Path)
    options = parser.parse_args()
    for stream in sorted(options.streams.glob("*.ivf")):
        golden = dict(np.load(options.goldens / f"{stream.stem}.golden.npz"))
        for record in range(len(golden["f_rec"])):
            print(stream.stem, record_line(golden, record))


if __name__ == "__main__":
    main()
