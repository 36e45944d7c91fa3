"""Colours of a model's points, from its images or from the video."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import tempfile
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.colmap_log import quiet_colmap
from mvmatch.encode.frames import open_frames
from mvmatch.errors import DataError, cannot_write
from mvmatch.export.files import make_folder
from mvmatch.export.model import images_by_frame, registered_images

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    import pycolmap
    from numpy.typing import NDArray


def color_points(model: pycolmap.Reconstruction, images: Path) -> int:
    """Give every point of a model its colour.

    From a folder a point takes the mean colour of all images that see it, as ``colmap
    color_extractor`` does. From a video it takes the colour of one frame, and only the few frames
    in which together every point is seen become pictures.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Its points get ``color``: (3,) uint8, red green blue; black where no picture was there.
    images : Path
        Folder that the image names are relative to, or the video whose frame numbers the image
        names carry.

    Returns
    -------
    int
        Pictures that were missing: no file in the folder, or beyond the end of the video.

    Raises
    ------
    DataError
        No picture is there, they cannot be read, or have not the size of the model's cameras.
    """
    points: Any = model.points3D
    for point in points.values():
        point.color = np.zeros(3, np.uint8)
    with quiet_colmap():
        return _from_folder(model, images) if images.is_dir() else _from_video(model, images)


def write_frames(model: pycolmap.Reconstruction, video: Path, folder: Path) -> int:
    """Write the frames of a video that have a pose as images, under their names in the model.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Its image names carry frame numbers; their endings choose the format.
    video : Path
        Any video FFmpeg decodes.
    folder : Path
        Made if missing.

    Returns
    -------
    int
        Images of the model beyond the end of the video.

    Raises
    ------
    DataError
        The video is not that of the model, a name leads out of the folder or has no ending of an
        image, or the folder cannot be written.
    """
    wanted = images_by_frame(model)
    written = 0
    for frame, picture in _decoded(video, wanted, _one_size(model)):
        _write_picture(picture, folder / _safe(wanted[frame].name))
        written += 1
    return len(wanted) - written


def _from_folder(model: pycolmap.Reconstruction, folder: Path) -> int:
    import pycolmap

    images = registered_images(model)
    there = [image for image in images if (folder / image.name).is_file()]
    if not there:
        raise DataError(
            f"{folder} holds no image of the model, whose first is {images[0].name}. "
            "Give the folder that the names are relative to"
        )
    first = pycolmap.Bitmap.read(folder / there[0].name, as_rgb=True)
    if first is None:
        raise DataError(f"{folder / there[0].name} is not an image COLMAP can read. Replace it")
    _check_size(model.camera(there[0].camera_id), (first.width, first.height), folder)
    model.extract_colors_for_all_images(folder)
    return len(images) - len(there)


def _from_video(model: pycolmap.Reconstruction, video: Path) -> int:
    images = images_by_frame(model)
    frames = {image.image_id: frame for frame, image in images.items()}
    wanted = _frames_that_see_all(model, frames)
    colored = 0
    with tempfile.TemporaryDirectory(prefix="mvmatch-colors-") as folder:
        for frame, picture in _decoded(video, wanted, _one_size(model)):
            path = Path(folder) / _safe(images[frame].name)
            _write_picture(picture, path)
            model.extract_colors_for_image(images[frame].image_id, folder)
            path.unlink()
            colored += 1
    return len(wanted) - colored


def _frames_that_see_all(model: pycolmap.Reconstruction, frames: Mapping[int, int]) -> set[int]:
    """Few frames in which together every point is seen.

    Points are taken in the order in which they disappear; one that is not seen yet adds the last
    frame that sees it. For points without gaps no smaller set exists.
    """
    points: Any = model.points3D
    seen_in = [
        {frames[e.image_id] for e in point.track.elements if e.image_id in frames}
        for point in points.values()
    ]
    chosen: set[int] = set()
    for seen in sorted(filter(None, seen_in), key=max):
        if chosen.isdisjoint(seen):
            chosen.add(max(seen))
    return chosen


def _decoded(
    video: Path, wanted: Iterable[int], camera: pycolmap.Camera
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Yield the wanted frames of a video as (H, W, 3) uint8, red green blue."""
    remaining = set(wanted)
    if not remaining:
        return
    last = max(remaining)
    # The rate only times the images of a folder.
    source = open_frames(video, frame_rate=30.0, max_frames=max(last + 1, 2))
    _check_size(camera, (source.width, source.height), video)
    found = False
    for frame, picture in enumerate(source):
        if frame in remaining:
            found = True
            yield frame, picture.to_ndarray(format="rgb24").astype(np.uint8, copy=False)
    if not found:
        raise DataError(
            f"{video} ends before the first wanted frame of the model, {min(remaining)}. "
            "Give the video that the model was made from"
        )


def _write_picture(picture: NDArray[np.uint8], path: Path) -> None:
    import pycolmap

    make_folder(path.parent)
    try:
        written = pycolmap.Bitmap.from_array(picture).write(path)
    except OSError as error:
        raise cannot_write(path, error) from error
    if not written:
        raise DataError(
            f"cannot write {path}: no room, or no known image ending. Choose another place"
        )


def _safe(name: str) -> PurePosixPath:
    """Return an image name that stays inside its folder."""
    path = PurePosixPath(name.replace("\\", "/"))
    if not path.parts or path.is_absolute() or ".." in path.parts or ":" in path.parts[0]:
        raise DataError(f"the image name {name} leads out of the folder. Rename the image")
    return path


def _one_size(model: pycolmap.Reconstruction) -> pycolmap.Camera:
    """Return a camera of the model, whose images are all of its size."""
    used = {image.camera_id for image in registered_images(model)}
    cameras = [model.camera(number) for number in sorted(used)]
    if len({(camera.width, camera.height) for camera in cameras}) != 1:
        raise DataError(
            "the model has images of several sizes, a video has one. Give the folder of images"
        )
    return cameras[0]


def _check_size(camera: pycolmap.Camera, size: tuple[int, int], where: Path) -> None:
    if size != (camera.width, camera.height):
        raise DataError(
            f"the pictures of {where} are {size[0]}x{size[1]} px but the model's are "
            f"{camera.width}x{camera.height}. Give those that the model was made from"
        )
