"""Pictures of a model's images, from a folder or from the video; read and written."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.encode.frames import open_frames
from mvmatch.errors import DataError, cannot_write
from mvmatch.export.files import make_folder
from mvmatch.export.model import images_by_frame, registered_images

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.types import StrPath


def model_pictures(
    model: pycolmap.Reconstruction, source: Path
) -> Iterator[tuple[pycolmap.Image, pycolmap.Bitmap]]:
    """Yield the images that have a pose with their pictures, one at a time.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Any model; for a video its image names carry frame numbers.
    source : Path
        Folder that the image names are relative to, or any video FFmpeg decodes, which is decoded
        once. What is not there is left out.

    Raises
    ------
    DataError
        No picture is there, one cannot be read, or has another size than its camera.
    """
    import pycolmap

    if source.is_dir():
        for image in images_there(model, source):
            picture = read_picture(source / image.name)
            camera = model.camera(image.camera_id)
            check_size(camera, (picture.width, picture.height), source / image.name)
            yield image, picture
    else:
        images = images_by_frame(model)
        for frame, picture in decoded_frames(source, images, one_size(model)):
            yield images[frame], pycolmap.Bitmap.from_array(picture)


def images_there(model: pycolmap.Reconstruction, folder: Path) -> list[pycolmap.Image]:
    """Images that have a pose and a file in a folder; none is a :class:`DataError`."""
    images = registered_images(model)
    there = [image for image in images if (folder / image.name).is_file()]
    if not there:
        raise DataError(
            f"{folder} holds no image of the model, whose first is {images[0].name}. "
            "Give the folder that the names are relative to"
        )
    return there


def read_picture(path: Path) -> pycolmap.Bitmap:
    """Read a picture as red, green and blue; what is none is a :class:`DataError`."""
    return _read(path, as_rgb=True)


def read_mask(path: Path, camera: pycolmap.Camera) -> pycolmap.Bitmap:
    """Read a mask as COLMAP takes it: what is not black is white, 255.

    Raises
    ------
    DataError
        It is no picture, or has not the size of the camera.
    """
    import pycolmap

    mask = _read(path, as_rgb=False)
    check_size(camera, (mask.width, mask.height), path)
    return pycolmap.Bitmap.from_array(np.where(mask.to_array(), 255, 0).astype(np.uint8))


def _read(path: Path, *, as_rgb: bool) -> pycolmap.Bitmap:
    import pycolmap

    picture = pycolmap.Bitmap.read(path, as_rgb=as_rgb)
    if picture is None:
        raise DataError(f"{path} is not an image COLMAP can read. Replace it")
    return picture


def write_frames(model: pycolmap.Reconstruction, video: StrPath, folder: StrPath) -> int:
    """Write the frames of a video that have a pose as images, under their names in the model.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Its image names carry frame numbers; their endings choose the format.
    video : path
        Any video FFmpeg decodes.
    folder : path
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
    video, folder = Path(video), Path(folder)
    written = 0
    for image, picture in model_pictures(model, video):
        write_picture(picture, folder / safe_name(image.name))
        written += 1
    return model.num_reg_images() - written


def decoded_frames(
    video: Path, wanted: Iterable[int], camera: pycolmap.Camera
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Yield the wanted frames of a video as (H, W, 3) uint8, red green blue."""
    remaining = set(wanted)
    if not remaining:
        return
    last = max(remaining)
    # The rate only times the images of a folder.
    source = open_frames(video, frame_rate=30.0, max_frames=max(last + 1, 2))
    check_size(camera, (source.width, source.height), video)
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


def write_picture(picture: pycolmap.Bitmap, path: Path) -> None:
    """Write a picture in the format that the ending names; the folder is made if missing."""
    make_folder(path.parent)
    try:
        written = picture.write(path)
    except OSError as error:
        raise cannot_write(path, error) from error
    if not written:
        raise DataError(
            f"cannot write {path}: no room, or no known image ending. Choose another place"
        )


def safe_name(name: str) -> PurePosixPath:
    """Return an image name that stays inside its folder."""
    path = PurePosixPath(name.replace("\\", "/"))
    if not path.parts or path.is_absolute() or ".." in path.parts or ":" in path.parts[0]:
        raise DataError(f"the image name {name} leads out of the folder. Rename the image")
    return path


def one_size(model: pycolmap.Reconstruction) -> pycolmap.Camera:
    """Return a camera of the model, whose images are all of its size."""
    used = {image.camera_id for image in registered_images(model)}
    cameras = [model.camera(number) for number in sorted(used)]
    if len({(camera.width, camera.height) for camera in cameras}) != 1:
        raise DataError(
            "the model has images of several sizes, a video has one. Give the folder of images"
        )
    return cameras[0]


def check_size(camera: pycolmap.Camera, size: tuple[int, int], where: Path) -> None:
    """Refuse pictures, of a size in px, that are not those of the camera."""
    if size != (camera.width, camera.height):
        raise DataError(
            f"the pictures of {where} are {size[0]}x{size[1]} px but the model's are "
            f"{camera.width}x{camera.height}. Give those that the model was made from"
        )
