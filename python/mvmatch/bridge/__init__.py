"""Descriptors where motion vectors fail: pictures that were coded anew, places seen again."""

from mvmatch.bridge.bridging import Bridge, bridge_tracks, find_gaps
from mvmatch.bridge.descriptors import require_matcher
from mvmatch.bridge.loops import LoopOptions, Loops, close_loops
from mvmatch.bridge.options import BridgeOptions

__all__ = [
    "Bridge",
    "BridgeOptions",
    "LoopOptions",
    "Loops",
    "bridge_tracks",
    "close_loops",
    "find_gaps",
    "require_matcher",
]
