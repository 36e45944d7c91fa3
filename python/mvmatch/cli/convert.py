"""The verb from a model to the files of other programs."""

# pyright: reportUnknownMemberType=false

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mvmatch.cli.console import Outcome, Ticker
from mvmatch.cli.settings import ExistingFile, ExistingPath, Json, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    import pycolmap

Target = Literal["text", "binary", "undistorted", "nerfstudio", "ply", "tum", "kitti"]

_NEXT = {
    "text": "colmap model_analyzer --path {}",
    "binary": "colmap model_analyzer --path {}",
    "undistorted": "colmap gui --import_path {0}/sparse/0 --image_path {0}/images",
    "nerfstudio": "ns-train splatfacto --data {}",
    "tum": "evo_traj tum {} --plot",
    "kitti": "evo_traj kitti {} --plot",
}
_TRAJECTORIES = ("tum", "kitti")


def convert(
    model: ExistingPath,
    out: Path,
    /,
    *,
    to: Target,
    images: ExistingPath | None = None,
    masks: ExistingPath | None = None,
    timestamps: ExistingFile | None = None,
    fps: float | None = None,
    json: Json = False,
) -> Outcome:
    """Write a COLMAP model for other programs.

    Parameters
    ----------
    model
        Folder of a COLMAP model, such as out/sparse/0.
    out
        text, binary, undistorted, nerfstudio: a folder; ply, tum, kitti: a file.
    to
        text, binary: COLMAP's own files; undistorted: images without distortion and sparse/0 with
        their pinhole cameras, as 3D Gaussian splatting reads them; nerfstudio: transforms.json and
        points; ply: points with colour, error and track length; tum, kitti: the path of the camera.
    images
        Folder of the images, or the video: colours the points. For undistorted it has to be given;
        for nerfstudio the frames of a video are written to OUT/images.
    masks
        For undistorted and nerfstudio: folder of masks, such as out/masks of `mvmatch run --masks`.
    timestamps
        For tum: the video, or a text file with the time of each frame in s.
    fps
        For tum: frames per s. Without it and --timestamps the frame number is the timestamp.
    """
    _check_words(to, images, masks, timestamps, fps)
    from mvmatch.export.model import read_model

    with Ticker() as tell:
        tell("read", 0, None)
        found = read_model(model)
        warnings: list[str] = []
        if images is not None and to != "undistorted":
            tell("color", 0, None)
            warnings += _color(found, images)
        elif to in {"ply", "nerfstudio"}:
            warnings += _black(found)
        tell("write", 0, None)
        if to == "undistorted":
            assert images is not None
            progress = functools.partial(tell, "undistort")
            facts = _write_undistorted(found, out, images, masks, progress)
        else:
            facts = _write(
                found, out, to, images=images, masks=masks, timestamps=timestamps, fps=fps
            )
    if facts.get("missing"):
        warnings.append(
            f"{facts['missing']} pictures are not in {images}: they are left out of the model."
        )
    if facts.get("first_frame"):
        warnings.append(
            f"The first frame with a pose is {facts['first_frame']}: line 1 of {out} belongs to it."
        )
    counts = {
        "num_images": found.num_reg_images(),
        "num_points": found.num_points3D(),
        "num_cameras": found.num_cameras(),
    }
    return Outcome(
        made=[out],
        figures={
            "model": f"{counts['num_images']} images, {counts['num_points']:,} points",
            **({"times": facts["times"]} if "times" in facts else {}),
        },
        next=_NEXT[to].format(out) if to in _NEXT else None,
        data={"format": to, **counts, **facts},
        warnings=warnings,
    )


def _check_words(
    to: Target,
    images: Path | None,
    masks: Path | None,
    timestamps: Path | None,
    fps: float | None,
) -> None:
    if to not in {"undistorted", "nerfstudio"} and masks is not None:
        raise UsageError("--masks is for --to undistorted and --to nerfstudio")
    if to != "tum" and (timestamps is not None or fps is not None):
        raise UsageError("--timestamps and --fps are for --to tum")
    if timestamps is not None and fps is not None:
        raise UsageError("--timestamps and --fps exclude each other")
    if fps is not None and not 0 < fps < float("inf"):
        raise UsageError(f"--fps takes frames per s, not {fps}")
    if images is None and to == "undistorted":
        raise UsageError("--to undistorted needs --images: the folder of the images, or the video")
    if images is not None and to in _TRAJECTORIES:
        raise UsageError(f"--images colours points, and --to {to} writes none")


def _color(model: pycolmap.Reconstruction, images: Path) -> list[str]:
    from mvmatch.export.colors import color_points

    missing = color_points(model, images)
    if not missing:
        return []
    return [f"{missing} pictures are not in {images}: points that only they see are black."]


def _black(model: pycolmap.Reconstruction) -> list[str]:
    points: Any = model.points3D
    if not points or any(point.color.any() for point in points.values()):
        return []
    return ["The points are black: mvmatch reads no pixels. --images FOLDER_OR_VIDEO colours them."]


def _write(
    model: pycolmap.Reconstruction,
    out: Path,
    to: Target,
    *,
    images: Path | None,
    masks: Path | None,
    timestamps: Path | None,
    fps: float | None,
) -> dict[str, Any]:
    """Write the files; return what is to be said about them."""
    if to == "text":
        from mvmatch.export.model import write_text

        write_text(model, out)
    elif to == "binary":
        from mvmatch.export.model import write_binary

        write_binary(model, out)
    elif to == "ply":
        from mvmatch.export.points import write_ply

        write_ply(model, out)
    elif to == "nerfstudio":
        _write_nerfstudio(model, out, images, masks)
    elif to == "kitti":
        from mvmatch.export.trajectory import write_kitti

        return {"first_frame": write_kitti(model, out).start}
    else:
        return _write_tum(model, out, timestamps, fps)
    return {}


def _write_undistorted(
    model: pycolmap.Reconstruction,
    out: Path,
    images: Path,
    masks: Path | None,
    progress: Callable[[int, int | None], None],
) -> dict[str, Any]:
    from mvmatch.export.undistorted import write_undistorted

    return {"missing": write_undistorted(model, images, out, masks=masks, progress=progress)}


def _write_nerfstudio(
    model: pycolmap.Reconstruction, out: Path, images: Path | None, masks: Path | None
) -> None:
    from mvmatch.export.nerfstudio import IMAGES, write_nerfstudio
    from mvmatch.export.pictures import write_frames

    if images is not None and images.is_file():
        write_frames(model, images, out / IMAGES)
        images = None
    write_nerfstudio(model, out, images=images, masks=masks)


def _write_tum(
    model: pycolmap.Reconstruction, out: Path, timestamps: Path | None, fps: float | None
) -> dict[str, Any]:
    import numpy as np

    from mvmatch.export.model import images_by_frame
    from mvmatch.export.trajectory import frame_times, write_tum

    times, source = None, "frame numbers"
    if timestamps is not None:
        times, source = frame_times(timestamps), f"s, of {timestamps}"
    elif fps is not None:
        times = np.arange(max(images_by_frame(model)) + 1) / fps
        source = f"s, at {fps:g} frames per s"
    write_tum(model, out, times=times)
    return {"times": source}
