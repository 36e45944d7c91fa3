"""COLMAP kept from writing to standard error: what matters comes back in results."""

# pyright: reportUnknownMemberType=false

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Generator

_FATAL = 3
"""COLMAP's level of what ends the process."""


@contextlib.contextmanager
def quiet_colmap() -> Generator[None]:
    """Let COLMAP write only what ends the process, as long as the block lasts."""
    import pycolmap

    level = pycolmap.logging.minloglevel
    pycolmap.logging.minloglevel = _FATAL
    try:
        yield
    finally:
        pycolmap.logging.minloglevel = level
