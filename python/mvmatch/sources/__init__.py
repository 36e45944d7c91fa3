"""Sources: video files in, one :class:`~mvmatch.types.MotionField` per coded frame out."""

from __future__ import annotations

from mvmatch.sources.base import MotionSource, open_video, sniff
from mvmatch.sources.frames import FrameFacts
from mvmatch.sources.options import Limits, ReadOptions, Skipped
from mvmatch.sources.reading import UntilDamage
from mvmatch.sources.structure import ReferenceStructure

__all__ = [
    "FrameFacts",
    "Limits",
    "MotionSource",
    "ReadOptions",
    "ReferenceStructure",
    "Skipped",
    "UntilDamage",
    "open_video",
    "sniff",
]
