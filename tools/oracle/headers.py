"""The arrays of a golden with one entry per record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from oracle.record import Record

    Value = Callable[[Record], Any]
    Where = Callable[[Record], bool]

# Facts with the same number in a golden and in the parser, by the golden's name: (field, neutral).
# On intra records the fields of INTER are neutral in a golden, because nothing codes them there.
SEQUENCE = {
    "f_profile": "seq_profile",
    "f_bit_depth": "bit_depth",
    "f_monochrome": "mono_chrome",
    "f_subsampling_x": "subsampling_x",
    "f_subsampling_y": "subsampling_y",
}
SEQUENCE_CODED = {
    "f_still_picture": "still_picture",
    "f_reduced_still_picture_header": "reduced_still_picture_header",
    "f_enable_order_hint": "enable_order_hint",
    "f_order_hint_bits": "order_hint_bits",
    "f_frame_id_numbers_present": "frame_id_numbers_present",
    "f_film_grain_params_present": "film_grain_params_present",
}
EVERY = {
    "f_frame_type": "frame_type",
    "f_order_hint": "order_hint",
    "f_refresh_frame_flags": "refresh_frame_flags",
}
CODED = {
    "f_showable_frame": "showable_frame",
    "f_upscaled_w": "upscaled_width",
    "f_upscaled_h": "frame_height",
    "f_frame_w": "frame_width",
    "f_frame_h": "frame_height",
    "f_render_w": "render_width",
    "f_render_h": "render_height",
    "f_superres_denom": "superres_denom",
    "f_mi_rows": "mi_rows",
    "f_mi_cols": "mi_cols",
    "f_base_q_idx": "base_q_idx",
    "f_primary_ref_frame": "primary_ref_frame",
    "f_error_resilient_mode": "error_resilient_mode",
    "f_disable_cdf_update": "disable_cdf_update",
    "f_allow_screen_content_tools": "allow_screen_content_tools",
    "f_allow_intrabc": "allow_intrabc",
    "f_reduced_tx_set": "reduced_tx_set",
    "f_tx_mode": "tx_mode",
    "f_coded_lossless": "coded_lossless",
    "f_delta_q_present": "delta_q_present",
    "f_delta_lf_present": "delta_lf_present",
    "f_delta_lf_multi": "delta_lf_multi",
    "f_seg_enabled": "segmentation_enabled",
    "f_seg_update_map": "segmentation_update_map",
    "f_seg_temporal_update": "segmentation_temporal_update",
    "f_segid_preskip": "seg_id_pre_skip",
    "f_using_qmatrix": "using_qmatrix",
    "f_tile_cols": "tile_cols",
    "f_tile_rows": "tile_rows",
    "f_uniform_tile_spacing": "uniform_tile_spacing",
    "f_context_update_tile_id": "context_update_tile_id",
    "f_apply_grain": "apply_grain",
    "f_cdef_bits": "cdef_bits",
    "f_current_frame_id": "current_frame_id",
}
INTER = {
    "f_allow_high_precision_mv": "allow_high_precision_mv",
    "f_allow_ref_frame_mvs": "use_ref_frame_mvs",
    "f_interp_filter": "interpolation_filter",
    "f_switchable_motion_mode": "is_motion_mode_switchable",
    "f_allow_warped_motion": "allow_warped_motion",
    "f_skip_mode_present": "skip_mode_present",
}
REFERENCES = {
    "ref_slot": ("ref_frame_idx", -1),
    "ref_order_hint": ("ref_order_hint", -1),
    "ref_sign_bias": ("ref_sign_bias", 0),
    "gm_type": ("gm_type", 0),
    "gm_params": ("gm_params", 0),
}

CODED_ONLY = "meaningless on show-existing records (GOLDEN.md)"
ZERO_WHEN_SHOWN = "0 on show-existing records although a sequence-level field (seen in the goldens)"
EVERYWHERE = "compared in every record"


class Column(NamedTuple):
    """An array per record: its value in our parser, and where a golden defines it."""

    name: str
    value: Value
    where: Where
    reason: str = CODED_ONLY
    needs_trace: bool = False


def always(_: Record) -> bool:
    return True


def is_coded(record: Record) -> bool:
    return not record.is_shown_again


def is_coded_inter(record: Record) -> bool:
    return not record.is_shown_again and record.is_inter


def fact(field: str) -> Value:
    return lambda record: record.header[field]


def inter_fact(field: str) -> Value:
    return lambda record: record.header[field] if record.is_inter else 0


def traced(field: str) -> Value:
    return lambda record: record.trace[field] if record.trace else None


def shown_slot(record: Record) -> int:
    """Return the golden's slot where ours holds the same frame: a golden names one of them."""
    if not record.is_shown_again:
        return -1
    held = record.golden["slot_decode_idx"][record.index]
    is_same = held[record.header["frame_to_show_map_idx"]] == record.frame.decode_index
    named = int(record.golden["f_sef_slot"][record.index])
    return named if is_same and held[named] == record.frame.decode_index else -2


def skip_mode_ref(index: int) -> Value:
    return lambda record: record.header["skip_mode_frame"][index] - 1


def reference(field: str, neutral: int) -> Value:
    def value(record: Record) -> np.ndarray:
        found = np.array(record.header[field], np.int64)
        return found if record.is_inter else np.full_like(found, neutral)

    return value


def ref_size(record: Record) -> np.ndarray:
    header = record.header
    size = np.stack([header["ref_upscaled_width"], header["ref_frame_height"]], axis=1)
    return size.astype(np.int64) if record.is_inter else np.full((7, 2), -1)


def slot(index: int) -> Value:
    def value(record: Record) -> list[int]:
        slots = record.trace["slots"] if record.trace else []
        return [-1 if held is None else held[index] for held in slots]

    return value


def tx_type_histogram(record: Record) -> np.ndarray:
    blocks = record.trace["transform_blocks"] if record.trace else np.zeros((0, 6), np.int64)
    coded = (blocks[:, 0] == 0) & (blocks[:, 5] == 0)
    return np.bincount(blocks[coded, 4], minlength=16)


COLUMNS = [
    Column("f_rec", lambda record: record.index, always, EVERYWHERE),
    Column("f_tu", lambda record: record.unit, always, EVERYWHERE),
    Column("f_decode_idx", lambda record: record.frame.decode_index, always, EVERYWHERE),
    Column("f_show_existing_frame", fact("show_existing_frame"), always, EVERYWHERE),
    Column("f_show_frame", fact("show_frame"), always, EVERYWHERE),
    Column("f_sef_slot", shown_slot, always, EVERYWHERE),
    Column("f_temporal_id", lambda record: record.frame.temporal_id, always, EVERYWHERE),
    Column("f_spatial_id", lambda record: record.frame.spatial_id, always, EVERYWHERE),
    *(Column(name, fact(field), always, EVERYWHERE) for name, field in (SEQUENCE | EVERY).items()),
    *(
        Column(name, fact(field), is_coded, ZERO_WHEN_SHOWN)
        for name, field in SEQUENCE_CODED.items()
    ),
    *(Column(name, fact(field), is_coded) for name, field in CODED.items()),
    *(Column(name, inter_fact(field), is_coded) for name, field in INTER.items()),
    Column(
        "f_num_operating_points",
        lambda record: len(record.header["operating_point_idc"]),
        is_coded,
        ZERO_WHEN_SHOWN,
    ),
    Column(
        "f_sb_size_mi",
        lambda record: 32 if record.header["use_128x128_superblock"] else 16,
        is_coded,
    ),
    Column(
        "f_cur_frame_force_integer_mv",
        fact("force_integer_mv"),
        is_coded_inter,
        "intra records hold libaom's raw flag; the specification forces it to 1 (TRAPS.md 15)",
    ),
    Column("f_delta_q_res", lambda record: 1 << record.header["delta_q_res"], is_coded),
    Column(
        "f_refresh_frame_context",
        lambda record: not record.header["disable_frame_end_update_cdf"],
        is_coded,
    ),
    Column("f_reference_mode", lambda record: 2 * record.header["reference_select"], is_coded),
    Column("f_skip_mode_ref0", skip_mode_ref(0), is_coded),
    Column("f_skip_mode_ref1", skip_mode_ref(1), is_coded),
    *(
        Column(
            f"f_lr_type_{plane}",
            lambda record, index=index: record.header["frame_restoration_type"][index],
            is_coded,
        )
        for index, plane in enumerate("yuv")
    ),
    Column("f_num_tile_groups", traced("num_tile_groups"), always, EVERYWHERE, needs_trace=True),
    Column("f_num_multi_syms", traced("num_multi_syms"), is_coded, needs_trace=True),
    Column("f_num_binary_syms", traced("num_binary_syms"), is_coded, needs_trace=True),
    *(
        Column(name, reference(field, neutral), is_coded)
        for name, (field, neutral) in REFERENCES.items()
    ),
    Column("ref_decode_idx", lambda record: record.frame.ref_decode_index, is_coded),
    Column("ref_size", ref_size, is_coded),
    Column("gm_invalid", lambda r: np.logical_not(r.header["is_gm_valid"]), is_coded),
    Column("slot_decode_idx", slot(0), always, EVERYWHERE, needs_trace=True),
    Column("slot_order_hint", slot(1), always, EVERYWHERE, needs_trace=True),
    Column("txb_stats", lambda record: record.frame.coefficient_stats(), is_coded),
    Column("tx_type_hist", tx_type_histogram, is_coded, needs_trace=True),
]


def compare_headers(record: Record) -> Iterator[tuple[str, bool | None]]:
    """Names of the arrays per record: equal, different, or None where no golden defines them."""
    for column in COLUMNS:
        if column.needs_trace and record.trace is None:
            continue
        if not column.where(record):
            yield column.name, None
            continue
        found = np.asarray(column.value(record)).astype(np.int64)
        yield column.name, np.array_equal(found, record.expected(column.name))
