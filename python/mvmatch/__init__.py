"""Motion vectors of AV1 video as correspondences, tracks and COLMAP models.

``import mvmatch`` brings NumPy alone; every public name is imported when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mvmatch.camera import (
        CameraChoice,
        parse_camera,
    )
    from mvmatch.config import (
        RunOptions,
        load_options,
    )
    from mvmatch.encode import (
        EncodeOptions,
        available_encoders,
        encode_video,
    )
    from mvmatch.errors import (
        BitstreamError,
        DataError,
        InternalError,
        LimitError,
        MissingExtraError,
        MvmatchError,
        NotAv1Error,
        UnsupportedError,
    )
    from mvmatch.export.colmap import (
        write_database,
    )
    from mvmatch.export.scores import (
        score_database,
    )
    from mvmatch.matching import (
        match_video,
    )
    from mvmatch.pipeline import (
        reconstruct_video,
    )
    from mvmatch.sfm import (
        MapperOptions,
        reconstruct,
    )
    from mvmatch.sources import (
        Limits,
        MotionSource,
        ReadOptions,
        open_video,
    )
    from mvmatch.store import (
        read_tracks,
        write_tracks,
    )
    from mvmatch.tracks import (
        TrackOptions,
        build_tracks,
    )
    from mvmatch.types import (
        Correspondences,
        MotionField,
        MotionFlags,
        Tracks,
        TwoViewScore,
        VideoInfo,
    )

__all__ = [
    "BitstreamError",
    "CameraChoice",
    "Correspondences",
    "DataError",
    "EncodeOptions",
    "InternalError",
    "LimitError",
    "Limits",
    "MapperOptions",
    "MissingExtraError",
    "MotionField",
    "MotionFlags",
    "MotionSource",
    "MvmatchError",
    "NotAv1Error",
    "ReadOptions",
    "RunOptions",
    "TrackOptions",
    "Tracks",
    "TwoViewScore",
    "UnsupportedError",
    "VideoInfo",
    "__version__",
    "available_encoders",
    "build_tracks",
    "encode_video",
    "load_options",
    "match_video",
    "open_video",
    "parse_camera",
    "read_tracks",
    "reconstruct",
    "reconstruct_video",
    "score_database",
    "write_database",
    "write_tracks",
]

__version__ = "0.1.0"

_HOME = {
    "camera": ["CameraChoice", "parse_camera"],
    "config": ["RunOptions", "load_options"],
    "encode": ["EncodeOptions", "available_encoders", "encode_video"],
    "errors": [
        "BitstreamError",
        "DataError",
        "InternalError",
        "LimitError",
        "MissingExtraError",
        "MvmatchError",
        "NotAv1Error",
        "UnsupportedError",
    ],
    "export.colmap": ["write_database"],
    "export.scores": ["score_database"],
    "matching": ["match_video"],
    "pipeline": ["reconstruct_video"],
    "sfm": ["MapperOptions", "reconstruct"],
    "sources": ["Limits", "MotionSource", "ReadOptions", "open_video"],
    "store": ["read_tracks", "write_tracks"],
    "tracks": ["TrackOptions", "build_tracks"],
    "types": [
        "Correspondences",
        "MotionField",
        "MotionFlags",
        "Tracks",
        "TwoViewScore",
        "VideoInfo",
    ],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        message = f"module 'mvmatch' has no attribute {name!r}"
        raise AttributeError(message)
    return getattr(importlib.import_module(f"mvmatch.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
