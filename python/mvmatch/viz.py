"""Pictures of motion and tracks, drawn with matplotlib into files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from mvmatch.types import MotionField, StrPath, Tracks

_DPI = 100


def draw_motion(
    motion_field: MotionField, path: StrPath, *, picture: ArrayLike | None = None
) -> Path:
    """Draw the vectors of one frame as arrows from block centres.

    Parameters
    ----------
    motion_field : MotionField
        Vectors of one frame, px. Arrows point to where the content lies in the reference.
    path : path
        File to write; the ending chooses PNG, SVG or PDF.
    picture : (H, W) or (H, W, 3) array, optional
        The frame itself, 0 to 255, drawn below.

    Returns
    -------
    Path
        ``path``.
    """
    path = Path(path)
    figure, axes = _canvas(motion_field.width, motion_field.height, picture)
    center = motion_field.centers
    length = np.linalg.norm(motion_field.mv, axis=1)
    axes.quiver(
        center[:, 0], center[:, 1], motion_field.mv[:, 0], motion_field.mv[:, 1], length,
        angles="xy", scale_units="xy", scale=1.0, cmap="viridis", units="dots", width=1.2,
    )  # fmt: skip
    return _save(figure, path)


def draw_tracks(
    tracks: Tracks,
    frame: int,
    path: StrPath,
    *,
    size: tuple[int, int],
    picture: ArrayLike | None = None,
    tail: int = 10,
) -> Path:
    """Draw the tracks that pass through a frame with where they came from.

    Parameters
    ----------
    tracks : Tracks
        Points in px.
    frame : int
        Display index of the frame to show.
    path : path
        File to write; the ending chooses PNG, SVG or PDF.
    size : (int, int)
        Width and height of the frame in px.
    picture : (H, W) or (H, W, 3) array, optional
        The frame itself, 0 to 255, drawn below.
    tail : int
        Earlier frames to show of each track.

    Returns
    -------
    Path
        ``path``.
    """
    path = Path(path)
    figure, axes = _canvas(*size, picture)
    lines, lengths = track_tails(tracks, frame, tail=tail)
    if lines:
        from matplotlib.collections import LineCollection

        drawn = LineCollection(lines, cmap="viridis", linewidths=0.8)
        drawn.set_array(np.asarray(lengths, np.float64))
        axes.add_collection(drawn)
    points = tracks.keypoints(frame)
    axes.plot(points[:, 0], points[:, 1], linestyle="none", marker=".", markersize=2, color="w")
    return _save(figure, path)


def track_tails(
    tracks: Tracks, frame: int, *, tail: int
) -> tuple[list[NDArray[np.float32]], list[int]]:
    """Return the last positions up to ``frame`` of each track seen in it.

    Returns
    -------
    lines : list of (K, 2) px, oldest first, 2 <= K <= tail + 1 observations.
    lengths : observations of each whole track.
    """
    lines: list[NDArray[np.float32]] = []
    lengths: list[int] = []
    observations = tracks.observations(frame)
    owners = np.searchsorted(tracks.offsets, observations, side="right") - 1
    for observation, track in zip(observations.tolist(), owners.tolist(), strict=True):
        begin, end = int(tracks.offsets[track]), int(tracks.offsets[track + 1])
        first = int(np.searchsorted(tracks.frame[begin:end], frame - tail)) + begin
        if observation > first:
            lines.append(tracks.xy[first : observation + 1])
            lengths.append(end - begin)
    return lines, lengths


def _canvas(width: int, height: int, picture: ArrayLike | None) -> tuple[Any, Any]:
    """Return a matplotlib figure of the size of a frame, and axes in its pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
    FigureCanvasAgg(figure)
    axes: Any = figure.add_axes((0, 0, 1, 1))  # pyright: ignore[reportUnknownMemberType]
    axes.set_axis_off()
    shown = np.zeros((height, width), np.uint8) if picture is None else np.asarray(picture)
    # Pixel centres are at (0.5, 0.5): the picture covers 0 to width, 0 to height.
    axes.imshow(shown, cmap="gray", vmin=0, vmax=255, extent=(0, width, height, 0))
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    return figure, axes


def _save(figure: Any, path: Path) -> Path:
    figure.savefig(path, dpi=_DPI)
    return path
