"""Tracks to hloc's ``features.h5`` and ``matches.h5``.

This is a door: hloc counts from the centre of the first pixel and adds 0.5 when it imports into
COLMAP, so 0.5 is taken away here.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.errors import DataError, MissingExtraError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import ModuleType

    from numpy.typing import NDArray

    from mvmatch.types import StrPath, Tracks

HLOC_FROM_COLMAP = -0.5
"""px, added to both coordinates."""


def write_hloc(
    tracks: Tracks,
    folder: StrPath,
    *,
    image_names: Sequence[str],
    max_gap: int | None = 10,
) -> tuple[Path, Path]:
    """Write tracks as hloc features and matches.

    ``features.h5`` holds ``<name>/keypoints`` (K, 2) float32; ``matches.h5`` holds
    ``<name0>/<name1>/matches0`` (K0,) int32, index into the other image or -1, and
    ``matching_scores0`` (K0,) float16, 1 where matched. A slash inside a name becomes a dash there.

    Parameters
    ----------
    tracks : Tracks
        Observations in px, COLMAP origin.
    folder : path
        Existing folder; each file appears under its name only when complete.
    image_names : sequence of str
        File name of every frame, index = frame number.
    max_gap : int or None
        Largest distance of frames that are matched; None for every pair of a track.

    Returns
    -------
    features, matches : Path

    Raises
    ------
    MissingExtraError
        h5py is not installed.
    DataError
        A track refers to a frame without a name, or the folder cannot be written.
    """
    folder = Path(folder)
    last = int(tracks.frame.max()) if len(tracks.frame) else -1
    if last >= len(image_names):
        raise DataError(f"tracks reach frame {last} but there are {len(image_names)} image names")
    features, matches = folder / "features.h5", folder / "matches.h5"
    _write_features(tracks, features, image_names)
    _write_matches(tracks, matches, image_names, max_gap)
    return features, matches


def _write_features(tracks: Tracks, path: Path, image_names: Sequence[str]) -> None:
    h5py = _h5py()
    partial = path.with_name(f".{path.name}.partial")
    try:
        with h5py.File(partial, "w") as file:
            for frame, name in enumerate(image_names):
                xy = tracks.keypoints(frame).astype(np.float32) + np.float32(HLOC_FROM_COLMAP)
                file.create_group(name).create_dataset("keypoints", data=xy)
        partial.replace(path)
    except OSError as error:
        raise DataError(f"cannot write {path}: {error}; choose another folder") from error
    finally:
        partial.unlink(missing_ok=True)


def _write_matches(
    tracks: Tracks, path: Path, image_names: Sequence[str], max_gap: int | None
) -> None:
    h5py = _h5py()
    counts = [len(tracks.keypoints(frame)) for frame in range(len(image_names))]
    partial = path.with_name(f".{path.name}.partial")
    try:
        with h5py.File(partial, "w") as file:
            for frame0, frame1, pairs in tracks.pairs(max_gap):
                names = [image_names[frame].replace("/", "-") for frame in (frame0, frame1)]
                group = file.create_group("/".join(names))
                matches0: NDArray[np.int32] = np.full(counts[frame0], -1, np.int32)
                matches0[pairs[:, 0]] = pairs[:, 1]
                group.create_dataset("matches0", data=matches0)
                group.create_dataset("matching_scores0", data=(matches0 >= 0).astype(np.float16))
        partial.replace(path)
    except OSError as error:
        raise DataError(f"cannot write {path}: {error}; choose another folder") from error
    finally:
        partial.unlink(missing_ok=True)


def _h5py() -> ModuleType:
    try:
        import h5py
    except ImportError as error:
        raise MissingExtraError(
            "the hloc export needs h5py: pip install 'mvmatch[hloc]'"
        ) from error
    return h5py
