"""Undistorted pictures, masks and their model, as splatting and dense matching read them.

A splat renders with pinhole cameras, and so do most programs for dense matching: the distortion of
the lens has to go from the pictures first. ``colmap image_undistorter`` does that to files; here
the pictures of a video are decoded, undistorted and written one at a time.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import copy
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.colmap_log import quiet_colmap
from mvmatch.errors import DataError, cannot_write
from mvmatch.export.colors import blacken, frames_that_see_all
from mvmatch.export.files import make_folder
from mvmatch.export.masks import mask_name, mask_of
from mvmatch.export.model import registered_images, write_binary
from mvmatch.export.pictures import model_pictures, read_mask, safe_name, write_picture

if TYPE_CHECKING:
    from collections.abc import Callable

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.types import StrPath

IMAGES = "images"
"""Folder of the undistorted pictures."""

MASKS = "masks"
"""Folder of the undistorted masks, where there are any."""

SPARSE = "sparse"
"""Folder of the model ``0``, where 3D Gaussian splatting and its kin look for it."""


def write_undistorted(
    model: pycolmap.Reconstruction,
    pictures: StrPath,
    folder: StrPath,
    *,
    masks: StrPath | None = None,
    progress: Callable[[int, int | None], None] | None = None,
) -> int:
    """Write ``images/`` without distortion, and ``sparse/0`` with the pinhole cameras they have.

    Masks go to ``masks/`` and fit the images there pixel by pixel.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Any model; it is not changed. In the one written each point has the colour of one picture,
        and images without a pose or a picture are left out.
    pictures : path
        Folder that the image names are relative to, or the video whose frame numbers they carry.
        One picture is in memory at a time.
    folder : path
        Made if missing; the folders appear in it when they are complete.
    masks : path, optional
        Folder of masks as COLMAP names them, ``NAME.png`` for the image ``NAME``: black where it is
        not to be looked at.
    progress : callable, optional
        Told after each picture.

    Returns
    -------
    int
        Images with a pose whose picture was not there.

    Raises
    ------
    DataError
        ``folder`` has such folders already; no picture is there, a mask is not, they cannot be read
        or have not the size of the model's cameras; or they cannot be written under their names.
    """
    pictures, folder = Path(pictures), Path(folder)
    masks = None if masks is None else Path(masks)
    parts = (IMAGES, SPARSE) if masks is None else (IMAGES, MASKS, SPARSE)
    for name in parts:
        if (folder / name).exists():
            raise DataError(f"{folder / name} is there already. Choose another folder")
    make_folder(folder)
    made = undistorted_model(model)
    try:
        with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=folder) as name, quiet_colmap():
            unfinished = Path(name)
            missing = _write_pictures(model, made, pictures, unfinished / IMAGES, progress)
            if masks is not None:
                _write_masks(model, made, masks, unfinished / MASKS)
            write_binary(made, unfinished / SPARSE / "0")
            for part in parts:
                (unfinished / part).replace(folder / part)
    except OSError as error:
        raise cannot_write(folder, error) from error
    return missing


def undistorted_model(model: pycolmap.Reconstruction) -> pycolmap.Reconstruction:
    """Return a model as pinhole cameras see it: the same points and poses, other pixels.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        It is not changed.

    Returns
    -------
    pycolmap.Reconstruction
        With cameras of the model PINHOLE, of a size at which no pixel of a picture is blank.
    """
    import pycolmap

    made = copy.deepcopy(model)
    for number in sorted(made.cameras):
        flat = pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(), model.camera(number))
        flat.camera_id = number
        flat.has_prior_focal_length = model.camera(number).has_prior_focal_length
        made.cameras[number] = flat
    for image in registered_images(made):
        observations = list(image.points2D)
        if observations:
            xy = np.array([observation.xy for observation in observations])
            number = image.camera_id
            moved = _moved(xy, model.camera(number), made.camera(number))
            for observation, place in zip(observations, moved, strict=True):
                observation.xy = place
    return made


def _moved(
    xy: NDArray[np.float64], camera: pycolmap.Camera, pinhole: pycolmap.Camera
) -> NDArray[np.float64]:
    """(N, 2) px where a pinhole camera sees what another one with a lens sees at ``xy``."""
    rays: Any = camera.cam_from_img(xy)
    moved: Any = pinhole.img_from_cam(np.column_stack([rays, np.ones(len(rays))]))
    # What lies beyond the reach of the lens model has no ray.
    return np.where(np.isfinite(moved), moved, xy)


def _write_pictures(
    model: pycolmap.Reconstruction,
    made: pycolmap.Reconstruction,
    pictures: Path,
    folder: Path,
    progress: Callable[[int, int | None], None] | None,
) -> int:
    """Write the pictures without distortion; colour the points, drop images without a picture."""
    missing = {image.image_id: image.frame_id for image in registered_images(made)}
    positions = {number: position for position, number in enumerate(missing)}
    numbers = list(positions)
    colouring = {numbers[position] for position in frames_that_see_all(made, positions)}
    blacken(made)
    for image, picture in model_pictures(model, pictures):
        camera = model.camera(image.camera_id)
        write_picture(_undistorted(picture, camera), folder / safe_name(image.name))
        if image.image_id in colouring:
            made.extract_colors_for_image(image.image_id, folder)
        del missing[image.image_id]
        if progress is not None:
            progress(len(positions) - len(missing), len(positions))
    for frame in set(missing.values()):
        made.deregister_frame(frame)
    return len(missing)


def _write_masks(
    model: pycolmap.Reconstruction, made: pycolmap.Reconstruction, masks: Path, folder: Path
) -> None:
    """Write the masks of the images of an undistorted model, by the same warp as the pictures."""
    import pycolmap

    for image in registered_images(made):
        camera = model.camera(image.camera_id)
        mask = read_mask(mask_of(image.name, masks), camera)
        # COLMAP interpolates; a mask is black or white.
        sharp = np.where(_undistorted(mask, camera).to_array() > 127, 255, 0).astype(np.uint8)
        write_picture(pycolmap.Bitmap.from_array(sharp), folder / safe_name(mask_name(image.name)))


def _undistorted(picture: pycolmap.Bitmap, camera: pycolmap.Camera) -> pycolmap.Bitmap:
    """Return the picture as the pinhole camera of :func:`undistorted_model` sees it."""
    import pycolmap

    if camera.model_name in {"SIMPLE_PINHOLE", "PINHOLE"}:
        return picture  # the warp would blacken its last row and column
    flat, _ = pycolmap.undistort_image(pycolmap.UndistortCameraOptions(), picture, camera)
    return flat
