"""Motion fields on a regular grid: what each 8x8 cell of a picture was predicted from.

AV1 codes in blocks of 4 to 128 px. On a grid, fields of different frames can be compared and
counted, and area counts instead of the number of blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mvmatch.types import MotionField

CELL = 8
"""px; side of a cell."""


def grid_shape(width: int, height: int, cell: int = CELL) -> tuple[int, int]:
    """Return rows and columns of the cells that cover a picture of that size in px.

    Examples
    --------
    >>> grid_shape(960, 540)
    (68, 120)
    """
    return -(-height // cell), -(-width // cell)


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldCells:
    """One motion field on the grid; a cell that no block covers is intra coded."""

    past: NDArray[np.int32]
    """(R, C) frames to the farthest past reference; 0 without one."""
    future: NDArray[np.int32]
    """(R, C) frames to the farthest future reference; 0 without one."""
    speed: NDArray[np.float32]
    """(R, C) length of the longest vector over the distance of its reference, px per frame."""

    @property
    def covered(self) -> NDArray[np.bool_]:
        """(R, C) cells with a vector."""
        return (self.past > 0) | (self.future > 0)

    @property
    def still(self) -> NDArray[np.bool_]:
        """(R, C) cells with a vector and none that moves."""
        return self.covered & (self.speed == 0)


def field_cells(field: MotionField) -> FieldCells:
    """Spread the rows of a field over the cells that they touch."""
    shape = grid_shape(field.width, field.height)
    row, cell = _touched(field.block, shape)
    distance = field.frame - field.ref_frame
    speed = np.hypot(field.mv[:, 0], field.mv[:, 1]) / np.maximum(np.abs(distance), 1)
    past, future = np.zeros(shape, np.int32), np.zeros(shape, np.int32)
    fastest = np.zeros(shape, np.float32)
    np.maximum.at(past.reshape(-1), cell, np.maximum(distance, 0)[row])
    np.maximum.at(future.reshape(-1), cell, np.maximum(-distance, 0)[row])
    np.maximum.at(fastest.reshape(-1), cell, speed.astype(np.float32)[row])
    return FieldCells(past=past, future=future, speed=fastest)


def _touched(
    block: NDArray[np.int32], shape: tuple[int, int]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(K,) block and (K,) cell, row by row, of every cell that a block touches."""
    start = np.clip(block[:, :2] // CELL, 0, (shape[1], shape[0])).astype(np.int64)
    end = np.clip(-(-(block[:, :2] + block[:, 2:]) // CELL), 0, (shape[1], shape[0]))
    columns, rows = (end - start).T
    count = columns * rows
    owner = np.repeat(np.arange(len(block), dtype=np.int64), count)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    line, column = np.divmod(within, columns[owner])
    return owner, (start[owner, 1] + line) * shape[1] + start[owner, 0] + column
