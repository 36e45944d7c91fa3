"""COLMAP models to nerfstudio's ``transforms.json``.

This is a door: nerfstudio's cameras look along -z with y up (OpenGL), so the y and z axes of each
camera change sign. World axes and pixels stay COLMAP's; there is no ``applied_transform``, of which
nerfstudio's versions disagree whether it applies to the points too.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.errors import DataError
from mvmatch.export.files import make_folder, write_file
from mvmatch.export.masks import mask_of
from mvmatch.export.model import registered_images
from mvmatch.export.pictures import read_mask
from mvmatch.export.points import write_ply

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pycolmap

    from mvmatch.types import StrPath

IMAGES = "images"
"""Folder of the images beside ``transforms.json``, where no other is given."""

POINTS = "sparse_pc.ply"
"""nerfstudio's own name of the points."""

_PERSPECTIVE = {
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"),
    "FULL_OPENCV",
}
_FISHEYE = {
    *("SIMPLE_FISHEYE", "FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"),
    "OPENCV_FISHEYE",
}
_OPENGL_FROM_COLMAP = np.diag([1.0, -1.0, -1.0, 1.0])


def write_nerfstudio(
    model: pycolmap.Reconstruction,
    folder: StrPath,
    *,
    images: StrPath | None = None,
    masks: StrPath | None = None,
) -> Path:
    """Write ``transforms.json`` and, where the model has points, ``sparse_pc.ply``.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Images without a pose are left out; the others are sorted by name.
    folder : path
        Made if missing. ``transforms.json`` appears last.
    images : path, optional
        Folder of the images; their paths are written relative to ``folder``. Without it they are
        expected in ``folder/images``.
    masks : path, optional
        Folder of masks as COLMAP names them, ``NAME.png`` for the image ``NAME``; their paths are
        written as ``mask_path``. nerfstudio too leaves out what is black in them.

    Returns
    -------
    Path
        ``transforms.json``.

    Raises
    ------
    DataError
        nerfstudio has no such camera model, the folder cannot be written, an image has no mask
        (nerfstudio takes masks for all or none), or masks have not the size of the images.
    """
    folder = Path(folder)
    images = None if images is None else Path(images)
    masks = None if masks is None else Path(masks)
    content = _intrinsics(model)
    shared = "fl_x" in content
    place = Path(IMAGES) if images is None else Path(os.path.relpath(images, folder))
    seen = registered_images(model)
    if masks is not None:  # one is looked at: those of a folder were made together
        read_mask(mask_of(seen[0].name, masks), model.camera(seen[0].camera_id))
    frames: list[dict[str, Any]] = []
    for image in seen:
        frame: dict[str, Any] = {"file_path": (place / image.name).as_posix()}
        if masks is not None:
            mask = mask_of(image.name, masks)
            frame["mask_path"] = Path(os.path.relpath(mask, folder)).as_posix()
        if not shared:
            frame |= _camera(model.camera(image.camera_id))
        frames.append(frame | {"transform_matrix": _transform_matrix(image)})
    make_folder(folder)
    if model.num_points3D():
        write_ply(model, folder / POINTS)
        content["ply_file_path"] = POINTS
    path = folder / "transforms.json"
    write_file(path, json.dumps({**content, "frames": frames}, indent=2, allow_nan=False) + "\n")
    return path


def _transform_matrix(image: pycolmap.Image) -> list[list[float]]:
    """Camera-to-world with OpenGL's camera axes."""
    world_from_cam = np.vstack([image.cam_from_world().inverse().matrix(), [0, 0, 0, 1]])
    return (world_from_cam @ _OPENGL_FROM_COLMAP).tolist()


def _intrinsics(model: pycolmap.Reconstruction) -> dict[str, Any]:
    """Return what all frames share: the kind of lens and, if there is one camera, its numbers."""
    used = {image.camera_id for image in registered_images(model)}
    cameras = [model.camera(number) for number in sorted(used)]
    kinds = {_camera_model(camera) for camera in cameras}
    if len(kinds) > 1:
        raise DataError(
            "the model has fisheye and other cameras, of which nerfstudio takes one kind per "
            "dataset. Convert a model of each kind alone"
        )
    return {"camera_model": kinds.pop(), **(_camera(cameras[0]) if len(cameras) == 1 else {})}


def _camera_model(camera: pycolmap.Camera) -> str:
    """Return nerfstudio's name of the lens."""
    name = camera.model.name
    rational = any(_parameters(camera).get(key) for key in ("k4", "k5", "k6"))
    if name in _FISHEYE:
        return "OPENCV_FISHEYE"
    if name not in _PERSPECTIVE or (name == "FULL_OPENCV" and rational):
        raise DataError(
            f"nerfstudio has no camera model like COLMAP's {name}. Undistort the images "
            "(--to undistorted) and convert the model of the undistorted ones"
        )
    return "OPENCV"


def _camera(camera: pycolmap.Camera) -> dict[str, float]:
    """Size in px, focal length and principal point in px, distortion."""
    given = _parameters(camera)
    focal = given.get("f", 0.0)
    distortion = ("k2", "k3", "k4") if camera.model.name in _FISHEYE else ("k2", "k3", "p1", "p2")
    return {
        "w": camera.width,
        "h": camera.height,
        "fl_x": given.get("fx", focal),
        "fl_y": given.get("fy", focal),
        "cx": given["cx"],
        "cy": given["cy"],
        "k1": given.get("k1", given.get("k", 0.0)),
        **{name: given.get(name, 0.0) for name in distortion},
    }


def _parameters(camera: pycolmap.Camera) -> Mapping[str, float]:
    """COLMAP's parameters by COLMAP's names: ``fx, fy, cx, cy, k1 ...``."""
    names = camera.params_info.replace(" ", "").split(",")
    return dict(zip(names, (float(value) for value in camera.params), strict=True))
