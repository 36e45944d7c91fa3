"""Condense goldens to digests: ``golden_digests.py STREAMS GOLDENS > expected.txt``.

``STREAMS`` is a folder of IVF files, ``GOLDENS`` one with a ``.golden.npz`` for each (libaom's
inspection hook). A line holds stream, record, decode index, order hint, number of blocks and three
digests: of the blocks with the references and coefficients, of the headers, and of the transforms
with the symbol counts. ``h = h * 0x100000001B3 + value`` modulo 2^64 over the values that
``crates/av1-motion/tests/golden`` lists in the same order.
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
# Facts of a frame's headers in digest order.
HEADER_FIELDS = [
    *("tu", "temporal_id", "spatial_id", "frame_type", "show_frame", "showable_frame"),
    *("upscaled_w", "frame_w", "frame_h", "render_w", "render_h", "superres_denom"),
    *("mi_rows", "mi_cols", "base_q_idx", "refresh_frame_flags", "primary_ref_frame"),
    *("error_resilient_mode", "disable_cdf_update", "allow_screen_content_tools"),
    *("allow_intrabc", "allow_high_precision_mv", "interp_filter", "switchable_motion_mode"),
    *("allow_ref_frame_mvs", "reference_mode", "skip_mode_present", "skip_mode_ref0"),
    *("skip_mode_ref1", "allow_warped_motion", "reduced_tx_set", "tx_mode"),
    *("refresh_frame_context", "coded_lossless", "delta_q_present", "delta_q_res"),
    *("delta_lf_present", "delta_lf_multi", "seg_enabled", "seg_update_map"),
    *("seg_temporal_update", "segid_preskip", "using_qmatrix", "tile_cols", "tile_rows"),
    *("uniform_tile_spacing", "context_update_tile_id", "sb_size_mi", "apply_grain"),
    *("cdef_bits", "lr_type_y", "lr_type_u", "lr_type_v", "current_frame_id", "profile"),
    *("bit_depth", "monochrome", "subsampling_x", "subsampling_y", "still_picture"),
    *("reduced_still_picture_header", "enable_order_hint", "order_hint_bits"),
    *("frame_id_numbers_present", "num_operating_points", "film_grain_params_present"),
]
REFERENCE_COLUMNS = ["ref_slot", "ref_order_hint", "ref_size", "ref_sign_bias"]
REFERENCE_COLUMNS += ["gm_type", "gm_params", "gm_invalid"]
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
        return f"{record} {facts[0]} {facts[1]} shown"
    cells = slice(golden["cell_off"][record], golden["cell_off"][record + 1])
    rows, cols = int(golden["f_mi_rows"][record]), int(golden["f_mi_cols"][record])
    row, col = np.divmod(np.arange(rows * cols), cols)
    is_origin = (golden["blk_row"][cells] == row) & (golden["blk_col"][cells] == col)
    columns = [
        golden[name][cells][is_origin].reshape(int(is_origin.sum()), -1).astype(np.int64)
        for name in CELL_COLUMNS
    ]
    frame = [golden[name][record].ravel() for name in ("ref_decode_idx", "txb_stats")]
    header = [golden[f"f_{name}"][record] for name in HEADER_FIELDS]
    header += [golden[name][record].ravel() for name in REFERENCE_COLUMNS]
    symbols = [golden[f"f_num_{name}"][record] for name in ("tile_groups", "multi_syms")]
    symbols.append(golden["f_num_binary_syms"][record])
    transforms = [golden["tx_size"][cells], golden["tx_type"][cells], *symbols]
    transforms += [golden[name][record] for name in ("tx_type_hist", "slot_decode_idx")]
    parts = [np.hstack(columns).ravel(), *frame], header, transforms
    digests = [digest(np.hstack(part)) for part in parts]
    counts = f"{record} {facts[0]} {facts[1]} {int(is_origin.sum())}"
    return f"{counts} {' '.join(f'{value:016x}' for value in digests)}"


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
