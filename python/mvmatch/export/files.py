"""Files that appear under their name only when complete."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from mvmatch.errors import cannot_write

if TYPE_CHECKING:
    from pathlib import Path


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file under a temporary name and rename it; an older one is replaced.

    Raises
    ------
    DataError
        The folder is missing or cannot be written, or ``path`` is a folder.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_bytes(content if isinstance(content, bytes) else content.encode())
        partial.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise cannot_write(path, error) from error


def make_folder(folder: Path) -> None:
    """Make a folder and those above it where they are missing.

    Raises
    ------
    DataError
        It cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
