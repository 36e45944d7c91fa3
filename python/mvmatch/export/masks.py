"""Masks for COLMAP: per frame a PNG that is black where nothing should be extracted.

COLMAP reads the mask of the image ``NAME`` from ``NAME.png`` in its ``mask_path``.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.cells import CELL, grid_shape
from mvmatch.errors import DataError, cannot_write

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from mvmatch.overlays import Overlays
    from mvmatch.types import StrPath, Tracks

GROWTH = 2
"""Cells of 8 px that an object reaches beyond its tracks, where no track at rest is nearer: a point
of a track stands for a block, and flat parts of an object have none."""


def write_masks(
    tracks: Tracks,
    moving: NDArray[np.bool_],
    folder: StrPath,
    *,
    size: tuple[int, int],
    image_names: Sequence[str],
    overlays: Overlays | None = None,
) -> list[Path]:
    """Write the mask of every frame: moving objects and static overlays black, the rest white.

    Parameters
    ----------
    tracks : Tracks
        All tracks, those at rest included.
    moving : (T,) bool
        Tracks on moving objects.
    folder : path
        Made if missing; ``image_names[k] + ".png"`` appears in it for every frame ``k``.
    size : tuple of int
        Width and height of the images in px.
    image_names : sequence of str
        File name of every frame.
    overlays : Overlays, optional
        Static overlays.

    Returns
    -------
    list of Path
        In the order of the frames.

    Raises
    ------
    DataError
        The folder cannot be written.
    """
    folder = Path(folder)
    paths = [folder / mask_name(name) for name in image_names]
    try:
        for frame, path in enumerate(paths):
            hidden = moving_cells(tracks, moving, frame, size)
            if overlays is not None:
                hidden |= overlays.at(frame)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(_png(mask_picture(hidden, size)))
    except OSError as error:
        raise cannot_write(folder, error) from error
    return paths


def mask_name(image_name: str) -> str:
    """Return COLMAP's name of the mask of an image.

    >>> mask_name("left/000012.jpg")
    'left/000012.jpg.png'
    """
    return f"{image_name}.png"


def mask_of(image_name: str, folder: Path) -> Path:
    """Return the mask of an image in a folder; none is a :class:`DataError`."""
    path = folder / mask_name(image_name)
    if not path.is_file():
        raise DataError(
            f"there is no mask {path}: either every image has one, or none is used. "
            "Give the folder that `mvmatch run --masks` wrote for this model"
        )
    return path


def moving_cells(
    tracks: Tracks, moving: NDArray[np.bool_], frame: int, size: tuple[int, int]
) -> NDArray[np.bool_]:
    """Cells of one frame that belong to moving objects.

    Cells with tracks take the kind of most of them; from there both kinds grow, cell by cell,
    until they meet.

    Returns
    -------
    (R, C) bool
        Cells of 8 px.
    """
    shape = grid_shape(*size)
    observed = tracks.observations(frame)
    on_object = moving[tracks.track_index[observed]]
    limit = (shape[1] - 1, shape[0] - 1)
    column, row = np.clip(tracks.xy[observed] // CELL, 0, limit).astype(np.int64).T
    votes = np.zeros(shape, np.int64)
    np.add.at(votes, (row, column), np.where(on_object, 1, -1))
    kind = np.sign(votes)
    for _ in range(GROWTH):
        around = np.pad(kind, 1)
        sums = sum(
            around[dy : dy + shape[0], dx : dx + shape[1]] for dy in range(3) for dx in range(3)
        )
        kind = np.where(kind == 0, np.sign(sums), kind)
    return np.asarray(kind > 0)


def mask_picture(hidden: NDArray[np.bool_], size: tuple[int, int]) -> NDArray[np.uint8]:
    """(H, W) uint8, 0 in hidden cells and 255 elsewhere, from (R, C) cells of 8 px."""
    pixels = np.repeat(np.repeat(hidden, CELL, axis=0), CELL, axis=1)[: size[1], : size[0]]
    return np.where(pixels, 0, 255).astype(np.uint8)


def _png(picture: NDArray[np.uint8]) -> bytes:
    from fractions import Fraction

    import av

    encoder = av.CodecContext.create("png", "w")
    assert isinstance(encoder, av.VideoCodecContext)
    encoder.height, encoder.width = picture.shape
    encoder.pix_fmt, encoder.time_base = "gray", Fraction(1, 1)
    frame = av.VideoFrame.from_ndarray(picture, format="gray")
    return b"".join(bytes(packet) for packet in [*encoder.encode(frame), *encoder.encode(None)])
