"""What counts as a gap between pictures, and how it is bridged."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from mvmatch.geometry.two_view import RansacOptions


@dataclass(frozen=True, kw_only=True)
class BridgeOptions:
    """Options of :func:`mvmatch.bridge.bridge_tracks`."""

    matcher: Literal["sift", "aliked", "none"] = "sift"
    """Descriptor matcher of pycolmap; ``aliked`` (with LightGlue) needs a pycolmap built with ONNX.
    ``none`` leaves gaps as they are."""
    min_tracks: int = 100
    """Tracks that go on from a picture to the next one; fewer are a gap: the mapper needs 30 points
    of an image that are known from two others, and many tracks are short or wrong at a gap."""
    min_ties: int = 150
    """Of these, tracks that are seen twice on either side; fewer are a gap as well: a chain of
    brief tracks bends, or breaks. Measured: with 100 a model of shaken footage broke; what held
    has 210 and more (preset ``fast``, others 320), but for one drive, which is better for it."""
    reach: int = 5
    """Pictures on each side of a gap that are matched with each other: points have to be seen from
    two of one side before they can tell where a picture of the other side was taken, and from more
    before both sides fit together well."""
    far_reach: int = 8
    """The same where that was not enough: a blurred or turned-away stretch lies between."""
    window: int = 10
    """Pictures back that a picture is matched with where gaps lie so close that the stretches
    around them meet: tracks of vectors are short there, and only descriptors see far."""
    near: int = 2
    """Pictures back that a picture is matched with by all of its features; with those farther back
    by the features that near pictures show as well: others are rarely found there."""
    max_num_features: int = 3000
    """Per picture, the largest first: with half of them poses are less exact, and matching is
    cheaper by a third."""
    max_image_size: int = 3200
    """px; pictures whose longer side has more are made smaller for SIFT, by a whole factor. 1080p
    at half its size takes a third of the time, but pictures on both sides of a jump share less."""
    min_inliers: int = 30
    """Matches of a pair that keep to its essential matrix. Fewer can be chance, and the mapper
    registers no image on fewer."""
    ransac: RansacOptions = field(default_factory=RansacOptions)
    """Of the essential matrix that matches of a pair have to keep."""

    def __post_init__(self) -> None:
        for name in (
            "min_tracks",
            "min_ties",
            "reach",
            "far_reach",
            "window",
            "near",
            "max_num_features",
            "max_image_size",
            "min_inliers",
        ):
            if getattr(self, name) < 1:
                message = f"{name} is {getattr(self, name)}; it must be at least 1"
                raise ValueError(message)
