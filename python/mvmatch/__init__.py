"""Motion vectors of AV1 video as correspondences, tracks and COLMAP models.

``import mvmatch`` brings NumPy alone; every public name is imported when it is first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mvmatch.errors import (
        BitstreamError,
        DataError,
        LimitError,
        MissingExtraError,
        MvmatchError,
        UnsupportedError,
    )
    from mvmatch.types import (
        Correspondences,
        MotionField,
        MotionFlags,
        TwoViewScore,
        VideoInfo,
    )

__all__ = [
    "BitstreamError",
    "Correspondences",
    "DataError",
    "LimitError",
    "MissingExtraError",
    "MotionField",
    "MotionFlags",
    "MvmatchError",
    "TwoViewScore",
    "UnsupportedError",
    "VideoInfo",
    "__version__",
]

__version__ = "0.1.0"

_HOME = {
    "errors": [
        "BitstreamError",
        "DataError",
        "LimitError",
        "MissingExtraError",
        "MvmatchError",
        "UnsupportedError",
    ],
    "types": ["Correspondences", "MotionField", "MotionFlags", "TwoViewScore", "VideoInfo"],
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        message = f"module 'mvmatch' has no attribute {name!r}"
        raise AttributeError(message)
    return getattr(importlib.import_module(f"mvmatch.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
