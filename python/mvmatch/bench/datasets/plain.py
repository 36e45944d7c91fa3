"""A folder of pictures, or a video, about which nothing is known.

Figures that need the truth are NaN. A ``camera.txt`` (a COLMAP camera) in the folder is heeded;
otherwise the camera is a prior.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mvmatch.bench.datasets.layout import Layout, folder_name, make_sequence, unknown_poses
from mvmatch.bench.datasets.sequence import Sequence
from mvmatch.bench.patches import write_png
from mvmatch.camera import parse_camera
from mvmatch.encode.frames import IMAGE_SUFFIXES, FrameSource, open_frames
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from av import VideoFrame
    from numpy.typing import NDArray


def load(place: Path) -> Sequence:
    """Read pictures in natural order, or count the frames of a video."""
    source = _open(place)
    if source.image_names is None:
        frames = VideoFrames(place)
        camera = parse_camera(None, source.width, source.height, pictures=place).camera
        return Sequence(
            name=LAYOUT.name(place),
            frames=frames,
            camera=camera,
            cam_from_world=unknown_poses(len(frames)),
            truth=None,
        )
    camera_file = place / "camera.txt"
    return make_sequence(
        LAYOUT.name(place),
        [place / name for name in source.image_names],
        str(camera_file) if camera_file.is_file() else None,
        unknown_poses(len(source.image_names)),
    )


class VideoFrames:
    """Frames of a video, decoded in order; to go back is to start anew.

    Parameters
    ----------
    path : Path
        Any video that FFmpeg decodes. It is decoded once to count its frames: containers do not
        always know.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._count = sum(1 for _ in _open(path))
        self._restart()

    def __len__(self) -> int:
        return self._count

    def read(self, index: int) -> NDArray[np.uint8]:
        """Return one picture, (H, W, 3) blue green red."""
        if not 0 <= index < self._count:
            raise IndexError(f"{self._path} has {self._count} frames, not a frame {index}")
        if index < self._position:
            self._restart()
        while self._position < index:
            self._frame = next(self._frames, None)
            self._position += 1
        if self._frame is None:
            raise DataError(f"{self._path} does not give frame {index} again: has it changed?")
        return np.asarray(self._frame.to_ndarray(format="bgr24"), np.uint8)

    def write(self, index: int, path: Path) -> Path:
        """Write one picture as PNG."""
        return write_png(self.read(index), path)

    def _restart(self) -> None:
        self._frames: Iterator[VideoFrame] = iter(_open(self._path))
        self._frame: VideoFrame | None = None
        self._position = -1


def _open(place: Path) -> FrameSource:
    # The rate only times the pictures of a folder.
    return open_frames(place, frame_rate=30.0, max_frames=None)


def _pictures(place: Path) -> list[Path]:
    return [path for path in place.glob("*") if path.suffix.lower() in IMAGE_SUFFIXES]


def _files(place: Path) -> list[Path]:
    return sorted([place] if place.is_file() else [*_pictures(place), *place.glob("camera.txt")])


LAYOUT = Layout(
    title="pictures or a video",
    recognises=lambda place: place.is_file() or bool(_pictures(place)),
    load=load,
    files=_files,
    name=lambda place: place.resolve().stem if place.is_file() else folder_name(place),
)
