"""Motion fields written by hand: small enough to check by eye."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvmatch.types import MotionField

if TYPE_CHECKING:
    from collections.abc import Sequence

Row = tuple["Sequence[int]", "Sequence[float]", int]
"""Block ``[x, y, w, h]`` px, vector ``[dx, dy]`` px, display index of the reference."""


def field_from_rows(
    frame: int,
    rows: Sequence[Row],
    *,
    decode_index: int | None = None,
    width: int = 64,
    height: int = 32,
) -> MotionField:
    """Motion field with the given rows and nothing special about any of them.

    Parameters
    ----------
    frame : int
        Display index, also the decode index unless that is given.
    rows : sequence of Row
        None for a frame that is intra coded throughout.
    decode_index : int, optional
        Position in decode order.
    width, height : int
        Picture size in px.

    Examples
    --------
    >>> field_from_rows(1, [([0, 0, 16, 16], (2.5, 0.0), 0)]).centers.tolist()
    [[8.0, 8.0]]
    """
    count = len(rows)
    return MotionField(
        frame=frame,
        decode_index=frame if decode_index is None else decode_index,
        pts=None,
        width=width,
        height=height,
        is_key=count == 0,
        is_shown=True,
        block=np.array([row[0] for row in rows], np.int32).reshape(-1, 4),
        mv=np.array([row[1] for row in rows], np.float32).reshape(-1, 2),
        ref_frame=np.array([row[2] for row in rows], np.int32),
        flags=np.zeros(count, np.uint16),
        segment_id=np.zeros(count, np.uint8),
        qindex=np.zeros(count, np.uint8),
        residual=np.zeros(count, np.float32),
        warp=np.full((count, 6), np.nan),
    )
