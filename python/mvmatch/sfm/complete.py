"""From a map of key frames to the model of a whole video.

A map of few frames and few tracks is a skeleton: right in shape, but not as exact as the video
allows. So all other images are registered to it, the tracks without a point are triangulated over
all images, and one adjustment moves everything together. Every step is linear in the length of the
video, since an image shares points only with its neighbours.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from mvmatch.sfm.adjust import adjust
from mvmatch.sfm.densify import DensifyOptions, DensifySummary, triangulate
from mvmatch.sfm.localize import localize

if TYPE_CHECKING:
    import pycolmap

    from mvmatch.sfm.keyframes import KeyframeSelection
    from mvmatch.sfm.localize import Unregistered
    from mvmatch.sfm.options import MapperOptions

_logger = logging.getLogger(__name__)

TRIANGULATION = DensifyOptions(max_error=4.0, min_share=0.5, min_angle=1.5)
"""Bounds as wide as the mapper's: poses are exact only after the adjustment that follows."""


def complete(
    model: pycolmap.Reconstruction, selection: KeyframeSelection, options: MapperOptions
) -> tuple[Unregistered, ...]:
    """Register, triangulate and adjust in place what key frames leave out; cameras stay.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        Map of the key frames.
    selection : KeyframeSelection
        The key frames, among the images that are to be in the model.
    options : MapperOptions
        Of the mapper.

    Returns
    -------
    tuple of Unregistered
        Images that could not be registered.
    """
    unregistered, added = _filled(model, selection, options)
    _logger.info(
        "%d images registered to the key frames, %d points added",
        model.num_reg_images() - len(selection.frames),
        added.num_added,
    )
    adjust(model, options)
    return unregistered


def _filled(
    model: pycolmap.Reconstruction, selection: KeyframeSelection, options: MapperOptions
) -> tuple[tuple[Unregistered, ...], DensifySummary]:
    """Register and triangulate; the tracks of all images are gone before the adjustment."""
    images = selection.read_images()
    unregistered = localize(
        model, selection.database, images, options=options.localize, seed=options.seed
    )
    among = selection.within_model(images.tracks)
    return unregistered, triangulate(model, images, among=among, options=TRIANGULATION)
