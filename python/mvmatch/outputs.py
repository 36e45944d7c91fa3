"""The folder of a run: its files, how they appear in it, and the plain facts of the report."""

from __future__ import annotations

import dataclasses
import datetime as dt
import importlib.metadata
import platform
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.errors import DataError
from mvmatch.opencv import has_opencv
from mvmatch.pairing import seen_in, shared
from mvmatch.sfm import foreign_models
from mvmatch.work import FOLDER

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from numpy.typing import NDArray

    from mvmatch.camera import CameraChoice
    from mvmatch.encode import EncodeResult
    from mvmatch.match import Match
    from mvmatch.refine import RefineOptions
    from mvmatch.sfm import DensifySummary, Diagnosis, MapperOptions, ReconstructionResult
    from mvmatch.types import Tracks, VideoInfo

VIDEO = "encoded.ivf"
"""The input encoded for matching; absent when the input was used as it is."""
TRACKS = "tracks.parquet"
DATABASE = "database.db"
MODEL = "sparse"
"""Folder of the COLMAP model ``0``, and of those of further parts; absent without any."""
MASKS = "masks"
"""Folder of COLMAP masks, one per picture; only with ``masks``."""
UNDISTORTED = "undistorted"
"""Folder of undistorted pictures and their model; only with ``undistort`` and a model."""
REPORT = "report.json"
PAGE = "report.html"

_OURS = (VIDEO, TRACKS, DATABASE, MODEL, MASKS, UNDISTORTED, PAGE, REPORT)
_PUBLISHING = f"{FOLDER}/publishing"
_LIBRARIES = ("numpy", "av", "pycolmap", "pyarrow")
_KEPT_FOCAL = 1e-6
"""Relative change of a focal length that is rounding only."""


def require_ours(out: Path) -> None:
    """Refuse a folder in which a run would replace what is not of mvmatch.

    Raises
    ------
    DataError
        ``out`` is a file, or holds something that is no run.
    """
    if out.exists() and not out.is_dir():
        message = f"{out} is a file. Give a folder for the results"
        raise DataError(message)
    if (out / _PUBLISHING).is_file():
        return
    if (out / REPORT).is_file():
        foreign = [f"{MODEL}/{path.name}" for path in foreign_models(out / MODEL)]
    else:
        foreign = [name for name in _OURS if (out / name).exists()]
    if foreign:
        message = (
            f"{out} holds {foreign[0]} that no run of mvmatch made: it would be replaced. "
            "Give another folder with -o"
        )
        raise DataError(message)


def publish(folders: Iterable[Path], out: Path) -> None:
    """Give what stages made its place; the report comes last, so that it means complete.

    Parameters
    ----------
    folders : iterable of Path
        Of the stages, in their order. What bears the name of a result is one; a later stage's
        takes the place of an earlier one's.
    out : Path
        Folder of the results. Files are linked where the disk can, else copied.
    """
    made = {name: folder / name for folder in folders for name in _OURS if (folder / name).exists()}
    # Stopped in the middle, the folder has no report, but what is in it is ours.
    (out / _PUBLISHING).touch()
    for name in reversed(_OURS):
        _remove(out / name)
    for name in _OURS:
        if name in made:
            _link(made[name], out / name)
    (out / _PUBLISHING).unlink()


def provenance() -> dict[str, Any]:
    """Return which programs made the report, and when."""
    versions = {name: _version(name) for name in _LIBRARIES}
    versions["python"] = platform.python_version()
    versions["system"] = platform.platform()
    now = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
    return {
        "schema_version": 2,
        "mvmatch": {
            "version": _version("mvmatch"),
            "created": now,
            "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
            "versions": versions,
        },
    }


def describe_input(source: Path, info: VideoInfo, encoding: EncodeResult | None) -> dict[str, Any]:
    """Return the key ``input`` of the report."""
    kind = "av1" if encoding is None else "frames" if encoding.image_names else "video"
    facts: dict[str, Any] = {"path": str(source), "kind": kind, **dataclasses.asdict(info)}
    facts["encoding"] = None
    if encoding is not None:
        facts["encoding"] = {
            "encoder": encoding.encoder,
            "settings": encoding.settings,
            "num_frames": encoding.num_frames,
            "num_bytes": encoding.num_bytes,
            "seconds": encoding.seconds,
            "cpu_seconds": encoding.cpu_seconds,
        }
    return facts


def describe_camera(choice: CameraChoice, model: ReconstructionResult) -> dict[str, Any]:
    """Return the key ``camera`` of the report."""
    final = None
    if model.reconstruction is not None and model.reconstruction.cameras:
        cameras: Any = model.reconstruction.cameras
        camera = next(iter(cameras.values()))
        final = [float(value) for value in camera.params]
    return {
        "source": choice.source,
        "is_prior": choice.is_prior,
        "model": choice.camera.model.name,
        "params": [float(value) for value in choice.camera.params],
        "final_params": final,
    }


def camera_warnings(
    choice: CameraChoice, model: ReconstructionResult, *, is_refined: bool = False
) -> list[str]:
    """Return what a user must know of the camera: guessed, made to fit, or corrected."""
    given, used = choice.camera.mean_focal_length(), _used_focal(model)
    is_kept = used is not None and abs(used / given - 1.0) < _KEPT_FOCAL
    if choice.is_prior:
        kept = ", which the model keeps" * is_kept
        told = (
            f"The camera is a guess ({choice.source}{kept}). "
            "With a calibration (--camera) the model is more accurate"
        )
        if not is_refined:
            means = "--refine" if has_opencv() else "OpenCV (pip install 'mvmatch[refine]')"
            told += f", with {means} the focal length"
        return [*choice.warnings, f"{told}."]
    if used is None or is_kept:
        return [*choice.warnings]
    return [
        *choice.warnings,
        f"The focal length of the {choice.source}, {given:.1f} px, contradicts the video: "
        f"the model uses {used:.1f} px ({used / given - 1.0:+.1%}). "
        "--set mapper.intrinsics=fixed holds it as given.",
    ]


def dense_warnings(match: Match, options: RefineOptions) -> list[str]:
    """Return what would make the points of further tracks exacter, if it is not there."""
    gains = len(match.further) > 0 and not match.footage.stands_still
    if not gains or match.is_further_refined or options.when != "auto" or has_opencv():
        return []
    return [
        "Further tracks are not aligned to the pictures; with OpenCV "
        "(pip install 'mvmatch[refine]') their points are exacter."
    ]


def _used_focal(model: ReconstructionResult) -> float | None:
    """Return the focal length of a model in px; None where there is no model."""
    if model.reconstruction is None or not model.reconstruction.cameras:
        return None
    cameras: Any = model.reconstruction.cameras
    return float(next(iter(cameras.values())).mean_focal_length())


def describe_model(
    model: ReconstructionResult,
    options: MapperOptions,
    dense: DensifySummary | None,
    diagnosis: Diagnosis,
) -> dict[str, Any]:
    """Return the key ``model`` of the report."""
    return {
        "status": diagnosis.status,
        "findings": [dataclasses.asdict(finding) for finding in diagnosis.findings],
        "mapper": options.mapper,
        "accepted": model.accepted,
        "reasons": list(model.reasons),
        "registered": model.registered,
        "total": model.total,
        "num_keyframes": model.num_keyframes,
        "unregistered": [dataclasses.asdict(image) for image in model.unregistered],
        "joints": [dataclasses.asdict(joint) for joint in model.joints],
        "further": [f"{MODEL}/{path.name}" for path in model.further],
        "num_points": model.num_points,
        "dense": None if dense is None else dataclasses.asdict(dense),
        "mean_reprojection_error": model.mean_reprojection_error,
        "mean_track_length": model.mean_track_length,
        "attempts": [dataclasses.asdict(attempt) for attempt in model.attempts],
    }


def with_loops(
    adjacency: NDArray[np.int64], tracks: Tracks, loops: Collection[tuple[int, int]]
) -> NDArray[np.int64]:
    """Return (P, 3) ``[frame0, frame1, count]`` of matches with those of loops, far apart."""
    if not loops:
        return adjacency
    near = seen_in(tracks, {frame for pair in loops for frame in pair})
    closed = [(first, second, len(shared(near, first, second))) for first, second in loops]
    counts = np.concatenate([np.array(closed, np.int64), adjacency])
    _, rows = np.unique(counts[:, :2], axis=0, return_index=True)
    return counts[rows]


def _link(source: Path, path: Path) -> None:
    """Give a file, or all files of a folder, a second name."""
    if source.is_dir():
        path.mkdir()
        for inner in source.iterdir():
            _link(inner, path / inner.name)
        return
    try:
        path.hardlink_to(source)
    except OSError:  # the disk knows no links
        partial = path.with_name(f".{path.name}.partial")
        shutil.copy2(source, partial)
        partial.replace(path)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None
