"""Small patches of pictures: cut out, deformed, aligned to a picture all at once.

Patches lie side by side in one image, so that OpenCV handles thousands of them in one call. Here a
point is a pixel (its integer index) and an offset from that pixel's centre.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.opencv import require_opencv

if TYPE_CHECKING:
    from types import ModuleType

    from numpy.typing import NDArray

    from mvmatch.refine.options import RefineOptions

_EIGENVALUE = 1 / 1024
"""OpenCV's unit of ``minEigThreshold`` in (grey levels per px)²: Scharr's weights sum up to 32."""


def opencv() -> ModuleType:
    """Import OpenCV, or say how to install it."""
    return require_opencv("refinement", extra="refine")


def split(xy: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Split (N, 2) positions in px into (N, 2) pixels and offsets from their centres."""
    pixel = np.floor(xy).astype(np.int64)
    return pixel, xy - 0.5 - pixel


def cut_patches(
    picture: NDArray[np.uint8], pixel: NDArray[np.int64], half: int
) -> NDArray[np.uint8]:
    """Return (N, P, P) patches with P = 2 half + 1 around (N, 2) pixels; edges are mirrored."""
    padded = np.pad(picture, half, mode="symmetric")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * half + 1, 2 * half + 1))
    inside = np.clip(pixel, 0, (picture.shape[1] - 1, picture.shape[0] - 1))
    return windows[inside[:, 1], inside[:, 0]]


def deform_patches(
    patches: NDArray[np.uint8],
    offset: NDArray[np.float64],
    deformation: NDArray[np.float64],
    half: int,
) -> NDArray[np.uint8]:
    """Show patches as they look after a deformation.

    Parameters
    ----------
    patches : (N, P, P) grey values.
    offset : (N, 2) px, point of each patch that becomes the centre of the new one.
    deformation : (N, 2, 2) derivative of new positions by old ones.
    half : side of the new patches is 2 half + 1 px.

    Returns
    -------
    (N, Q, Q) grey values; what lies outside a patch repeats its edge.
    """
    cv2 = opencv()
    number, side = len(patches), patches.shape[1]
    step = np.arange(-half, half + 1, dtype=np.float32)
    inverse = np.linalg.inv(deformation).astype(np.float32)[:, :, :, None, None]
    centers = _centers(number, side).astype(np.float32)
    limit = np.float32(side // 2)
    maps: list[NDArray[np.float32]] = []
    for axis in range(2):
        source = inverse[:, axis, 0] * step[None, :] + inverse[:, axis, 1] * step[:, None]
        source += offset[:, axis, None, None].astype(np.float32)
        np.clip(source, -limit, limit, out=source)
        maps.append(_join(source + centers[:, axis, None, None]))
    joined = cv2.remap(_join(patches), *maps, cv2.INTER_CUBIC)
    return _part(np.asarray(joined, np.uint8), number, 2 * half + 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """Where patches lie in a picture."""

    xy: NDArray[np.float64]
    """(N, 2) px."""
    found: NDArray[np.bool_]
    """(N,) whether the position can be trusted."""


def align_patches(
    patches: NDArray[np.uint8],
    picture: NDArray[np.uint8],
    guess: NDArray[np.float64],
    options: RefineOptions,
) -> Alignment:
    """Find patches in a picture near a guess (Lucas-Kanade), and back.

    Parameters
    ----------
    patches : (N, P, P) grey values, P at least ``options.window`` and room to move.
    picture : (H, W) grey values.
    guess : (N, 2) px, where the centres of the patches should be.
    options : RefineOptions
        Window and limits.
    """
    cv2 = opencv()
    pixel, offset = split(guess)
    side = patches.shape[1]
    after = _join(cut_patches(picture, pixel, side // 2))
    start = _centers(len(patches), side).astype(np.float32)
    expected = start + offset.astype(np.float32)
    settings: dict[str, Any] = {
        "winSize": (options.window, options.window),
        "maxLevel": 0,
        "criteria": (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.01),
        "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
        "minEigThreshold": options.min_texture * _EIGENVALUE,
    }

    def follow(
        first: NDArray[np.uint8],
        second: NDArray[np.uint8],
        origin: NDArray[np.float32],
        target: NDArray[np.float32],
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        moved, found, _ = cv2.calcOpticalFlowPyrLK(first, second, origin, target.copy(), **settings)
        return np.asarray(moved, np.float32), found.ravel() == 1

    def near(xy: NDArray[np.float32]) -> NDArray[np.bool_]:
        return np.linalg.norm(xy - expected, axis=1) <= options.max_move

    there, found = follow(_join(patches), after, start, expected)
    there = np.where((found & near(there))[:, None], there, expected)
    before = _join(_as_bright(patches, after, start, there, options.window))
    there, found = follow(before, after, start, there)
    back, returned = follow(after, before, there, there - offset.astype(np.float32))
    xy = pixel + 0.5 + (there - start).astype(np.float64)
    trusted = found & returned & near(there)
    trusted &= np.linalg.norm(back - start, axis=1) <= options.max_round_trip
    trusted &= ((xy >= 0) & (xy <= (picture.shape[1], picture.shape[0]))).all(axis=1)
    return Alignment(xy=xy, found=trusted)


def _as_bright(
    patches: NDArray[np.uint8],
    joined: NDArray[np.uint8],
    start: NDArray[np.float32],
    there: NDArray[np.float32],
    window: int,
) -> NDArray[np.uint8]:
    """Lift patches to the mean grey of the windows around ``there``.

    Lucas-Kanade takes light for motion; cameras change exposure, surfaces change with the view.
    Means are compared where a first alignment ended: at the guess they would pull points there.
    """
    cv2 = opencv()
    means: list[NDArray[np.float32]] = []
    for image, xy in ((_join(patches), start), (joined, there)):
        blurred = cv2.blur(image.astype(np.float32), (window, window))
        means.append(cv2.remap(blurred, xy[:, None, :], None, cv2.INTER_LINEAR).ravel())
    lift = (means[1] - means[0])[:, None, None]
    return np.clip(np.rint(patches + lift), 0, 255).astype(np.uint8)


def _columns(number: int) -> int:
    """Patches side by side, so that the joined image is about square."""
    return max(1, int(np.ceil(np.sqrt(number))))


def _join(patches: NDArray[Any]) -> NDArray[Any]:
    """Lay (N, P, P) patches out in one image."""
    number, side = patches.shape[:2]
    columns = _columns(number)
    rows = -(-number // columns)
    laid = np.zeros((rows * columns, side, side), patches.dtype)
    laid[:number] = patches
    laid = laid.reshape(rows, columns, side, side).transpose(0, 2, 1, 3)
    return laid.reshape(rows * side, columns * side)


def _part(image: NDArray[np.uint8], number: int, side: int) -> NDArray[np.uint8]:
    """Undo :func:`_join`."""
    columns = _columns(number)
    parts = image.reshape(-1, side, columns, side).transpose(0, 2, 1, 3)
    return parts.reshape(-1, side, side)[:number]


def _centers(number: int, side: int) -> NDArray[np.float64]:
    """(N, 2) pixel indices [x, y] of the patches' centres in the joined image."""
    row, column = np.divmod(np.arange(number), _columns(number))
    return np.stack([column, row], axis=1) * float(side) + side // 2
