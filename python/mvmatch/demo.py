"""The demo: a rendered street drive goes through the whole path and is compared with the truth."""

from __future__ import annotations

import dataclasses
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.config import RunOptions
from mvmatch.errors import DataError
from mvmatch.geometry.trajectory import TrajectoryError, trajectory_error
from mvmatch.measure import StageClock
from mvmatch.pipeline import Run, reconstruct_video
from mvmatch.report import write_report
from mvmatch.testing import SyntheticScene, synthetic_drive

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mvmatch.match import Progress
    from mvmatch.types import StrPath

IMAGES = "images"
"""Folder of the rendered frames."""
TRUTH = "truth_poses.txt"
"""Camera to world, one 3x4 matrix per line, row-major, m."""

FRAME_RATE = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Demo:
    """What :func:`run_demo` made."""

    run: Run
    error: TrajectoryError | None
    """Path of the registered images against the truth; None when fewer than three registered."""


def run_demo(
    out: StrPath,
    *,
    num_frames: int = 40,
    size: tuple[int, int] = (640, 360),
    options: RunOptions | None = None,
    progress: Progress | None = None,
) -> Demo:
    """Render a synthetic drive, encode and reconstruct it, and compare the path with the truth.

    Parameters
    ----------
    out : path
        Folder for the frames, the truth and everything :func:`reconstruct_video` makes.
    num_frames : int
        Frames to render.
    size : (int, int)
        Width and height in px.
    options : RunOptions, optional
        Options of all stages.
    progress : Progress, optional
        Told about all stages.

    Raises
    ------
    DataError
        ``out`` holds images that are not the demo's, or cannot be written.
    """
    out = Path(out)
    scene = synthetic_drive(num_frames, size)
    options = options or RunOptions()
    encode = dataclasses.replace(options.encode, frame_rate=FRAME_RATE)
    clock = StageClock()
    with clock.stage("render"):
        images = _render(scene, out, progress)
    fx, fy, cx, cy = scene.K[0, 0], scene.K[1, 1], scene.K[0, 2], scene.K[1, 2]
    run = reconstruct_video(
        images,
        out,
        camera=f"PINHOLE,{fx},{fy},{cx},{cy}",
        options=dataclasses.replace(options, encode=encode),
        progress=progress,
    )
    error = _compare(scene, run)
    rendering = dataclasses.asdict(clock.stages[0]) | {"reused": False}
    run.data["stages"].insert(0, rendering)
    if error is not None:
        run.data["accuracy"] = {
            "ate_percent": error.percent_of_path,
            "path_length": error.path_length,
            "ate": error.rmse,
        }
    write_report(out, run.data)
    return Demo(run=run, error=error)


def _render(scene: SyntheticScene, out: Path, progress: Progress | None) -> Path:
    """Write the frames and the truth; return the folder of the frames."""
    images = out / IMAGES
    if images.exists() and not (out / TRUTH).exists():
        message = f"{images} exists and was not made by the demo. Give another folder"
        raise DataError(message)
    try:
        images.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"cannot write into {out} ({error.strerror}). Choose another folder"
        raise DataError(message) from error
    for old in images.glob("frame_*.png"):
        old.unlink()
    world_from_cam = np.concatenate(
        [scene.cam_from_world[:, :, :3].transpose(0, 2, 1), scene.centers[:, :, None]], axis=2
    )
    np.savetxt(out / TRUTH, world_from_cam.reshape(-1, 12), fmt="%.12g")
    with ThreadPoolExecutor(max_workers=min(os.cpu_count() or 1, 8)) as pool:
        for index, picture in enumerate(pool.map(scene.render, range(scene.num_frames))):
            _write_png(images / f"frame_{index:06d}.png", picture)
            if progress is not None:
                progress("render", index + 1, scene.num_frames)
    return images


def _write_png(path: Path, picture: NDArray[np.uint8]) -> None:
    import av

    codec: Any = av.CodecContext.create("png", "w")
    codec.width, codec.height, codec.pix_fmt = picture.shape[1], picture.shape[0], "rgb24"
    codec.time_base = 1
    packets = codec.encode(av.VideoFrame.from_ndarray(picture, format="rgb24"))
    path.write_bytes(b"".join(bytes(packet) for packet in (*packets, *codec.encode(None))))


def _compare(scene: SyntheticScene, run: Run) -> TrajectoryError | None:
    model: Any = run.model.reconstruction
    if model is None:
        return None
    centers: dict[int, NDArray[np.float64]] = {}
    for image in model.images.values():
        if image.has_pose:
            frame = int(image.name.removeprefix("frame_").removesuffix(".png"))
            centers[frame] = np.asarray(image.projection_center(), np.float64)
    if len(centers) < 3:
        return None
    frames = sorted(centers)
    return trajectory_error(np.stack([centers[f] for f in frames]), scene.centers[frames])
