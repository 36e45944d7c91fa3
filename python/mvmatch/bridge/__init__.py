"""Descriptors where motion vectors fail: pictures so far apart that the encoder coded them anew."""

from mvmatch.bridge.bridging import Bridge, bridge_tracks, find_gaps
from mvmatch.bridge.options import BridgeOptions

__all__ = ["Bridge", "BridgeOptions", "bridge_tracks", "find_gaps"]
