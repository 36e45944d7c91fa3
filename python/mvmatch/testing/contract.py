"""What every motion source promises; plug-in authors run this on theirs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

    from mvmatch.types import MotionField

COLUMNS: dict[str, tuple[str, tuple[int, ...]]] = {
    "block": ("int32", (4,)),
    "mv": ("float32", (2,)),
    "ref_frame": ("int32", ()),
    "flags": ("uint16", ()),
    "segment_id": ("uint8", ()),
    "qindex": ("uint8", ()),
    "residual": ("float32", ()),
    "warp": ("float64", (6,)),
}
"""dtype and shape of a row of each column of a motion field."""

MAX_OVERHANG = 127
"""px: a 128 px block that starts inside the picture reaches at most this far outside."""


def check_source(source: Iterable[MotionField]) -> int:
    """Check that a motion source keeps its promises.

    Decode indices rise and references decode earlier; blocks start inside the picture and
    overhang it by at most 127 px; vectors are finite and point to another frame; every column has
    its dtype and shape; a key frame has no rows.

    Parameters
    ----------
    source : anything that yields motion fields in decode order.

    Returns
    -------
    Number of fields seen.

    Raises
    ------
    AssertionError : names the frame, the column and the first row that break a promise.
    """
    seen: set[int] = set()
    last_decode_index = -1
    count = 0
    for motion_field in source:
        where = f"frame {motion_field.frame} (decode index {motion_field.decode_index})"
        _require(
            motion_field.decode_index > last_decode_index, f"{where}: decode indices must rise"
        )
        _check_columns(motion_field, where)
        _check_blocks(motion_field, where)
        _check_vectors(motion_field, where, seen)
        last_decode_index = motion_field.decode_index
        seen.add(motion_field.frame)
        count += 1
    _require(count > 0, "the source yields no motion field")
    return count


def _check_columns(motion_field: MotionField, where: str) -> None:
    rows = len(motion_field.block)
    for name, (dtype, shape) in COLUMNS.items():
        column = getattr(motion_field, name)
        _require(
            column.dtype == np.dtype(dtype), f"{where}: {name} is {column.dtype}, must be {dtype}"
        )
        _require(
            column.shape == (rows, *shape),
            f"{where}: {name} has shape {column.shape}, must be {(rows, *shape)}",
        )
    _require(not (motion_field.is_key and rows), f"{where}: a key frame has {rows} vectors")


def _check_blocks(motion_field: MotionField, where: str) -> None:
    if not len(motion_field):
        return
    size = np.array([motion_field.width, motion_field.height])
    corner, extent = motion_field.block[:, :2], motion_field.block[:, 2:]
    _require_rows((corner >= 0).all(axis=1), f"{where}: block starts left of or above the picture")
    _require_rows((corner < size).all(axis=1), f"{where}: block starts outside the picture")
    _require_rows((extent > 0).all(axis=1), f"{where}: block is empty")
    _require_rows(
        (corner + extent <= size + MAX_OVERHANG).all(axis=1), f"{where}: block overhangs too far"
    )


def _check_vectors(motion_field: MotionField, where: str, seen: set[int]) -> None:
    if not len(motion_field):
        return
    _require_rows(np.isfinite(motion_field.mv).all(axis=1), f"{where}: mv is not finite")
    _require_rows(motion_field.ref_frame != motion_field.frame, f"{where}: refers to itself")
    decoded = np.isin(motion_field.ref_frame, np.fromiter(seen, np.int64, len(seen)))
    _require_rows(decoded, f"{where}: ref_frame was not decoded before")
    partly = np.isnan(motion_field.warp).any(axis=1) & ~np.isnan(motion_field.warp).all(axis=1)
    _require_rows(~partly, f"{where}: warp is partly NaN")
    _require_rows(motion_field.residual >= 0, f"{where}: residual is negative or NaN")


def _require(condition: bool, message: str) -> None:  # noqa: FBT001 - reads as a sentence
    if not condition:
        raise AssertionError(message)


def _require_rows(good: ArrayLike, message: str) -> None:
    good = np.asarray(good)
    if not good.all():
        raise AssertionError(f"{message} (row {int(np.argmin(good))} of {len(good)})")
