"""OpenCV, which is optional."""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING

from mvmatch.errors import MissingExtraError

if TYPE_CHECKING:
    from types import ModuleType


def require_opencv(what: str, *, extra: str) -> ModuleType:
    """Import OpenCV.

    Parameters
    ----------
    what : str
        Who needs it, for the message.
    extra : str
        Extra of mvmatch that brings it.

    Raises
    ------
    MissingExtraError
        It is not installed.
    """
    try:
        import cv2
    except ImportError as error:
        message = f"{what} needs OpenCV: pip install 'mvmatch[{extra}]'"
        raise MissingExtraError(message) from error
    return cv2


def has_opencv() -> bool:
    """Return whether OpenCV is installed."""
    return importlib.util.find_spec("cv2") is not None
