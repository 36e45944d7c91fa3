"""Colours of a model's points, from its images or from the video."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.colmap_log import quiet_colmap
from mvmatch.export.model import images_by_frame
from mvmatch.export.pictures import (
    check_size,
    decoded_frames,
    images_there,
    one_size,
    read_picture,
    safe_name,
    write_picture,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pycolmap

    from mvmatch.types import StrPath


def color_points(model: pycolmap.Reconstruction, images: StrPath) -> int:
    """Give every point of a model its colour.

    From a folder a point takes the mean colour of all images that see it, as ``colmap
    color_extractor`` does. From a video it takes the colour of one frame, and only the few frames
    in which together every point is seen become pictures.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Its points get ``color``: (3,) uint8, red green blue; black where no picture was there.
    images : path
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
    images = Path(images)
    blacken(model)
    with quiet_colmap():
        return _from_folder(model, images) if images.is_dir() else _from_video(model, images)


def blacken(model: pycolmap.Reconstruction) -> None:
    """Make all points black: what COLMAP takes for not coloured yet."""
    points: Any = model.points3D
    for point in points.values():
        point.color = np.zeros(3, np.uint8)


def _from_folder(model: pycolmap.Reconstruction, folder: Path) -> int:
    there = images_there(model, folder)
    first = read_picture(folder / there[0].name)
    check_size(model.camera(there[0].camera_id), (first.width, first.height), folder)
    model.extract_colors_for_all_images(folder)
    return model.num_reg_images() - len(there)


def _from_video(model: pycolmap.Reconstruction, video: Path) -> int:
    import pycolmap

    images = images_by_frame(model)
    frames = {image.image_id: frame for frame, image in images.items()}
    wanted = frames_that_see_all(model, frames)
    colored = 0
    with tempfile.TemporaryDirectory(prefix="mvmatch-colors-") as folder:
        for frame, picture in decoded_frames(video, wanted, one_size(model)):
            path = Path(folder) / safe_name(images[frame].name)
            write_picture(pycolmap.Bitmap.from_array(picture), path)
            model.extract_colors_for_image(images[frame].image_id, folder)
            path.unlink()
            colored += 1
    return len(wanted) - colored


def frames_that_see_all(model: pycolmap.Reconstruction, frames: Mapping[int, int]) -> set[int]:
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
