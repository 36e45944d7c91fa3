"""Digests of code and data: what tells a result that still holds from one that does not."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

from mvmatch.bench.datasets import layout_of
from mvmatch.encode.frames import IMAGE_SUFFIXES

if TYPE_CHECKING:
    from collections.abc import Sequence as Many


def code_digest(modules: Many[str]) -> str:
    """Digest of the files of modules of mvmatch, named by path inside the package."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    for module in sorted(modules):
        files = [*package.glob(f"{module}.*"), package / module]
        files += sorted((package / module).rglob("*.py"))
        for path in files:
            if path.is_file():
                digest.update(path.name.encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()


def folder_digest(folder: Path) -> str:
    """Digest of a sequence: its files, and the names and sizes of its images, or of its video."""
    digest = hashlib.sha256()
    layout = layout_of(folder)
    for path in layout.files(folder) if layout is not None else ():
        if path == folder or path.suffix.lower() in IMAGE_SUFFIXES:
            digest.update(f"{path.name} {path.stat().st_size}\n".encode())
        else:
            digest.update(path.read_bytes())
    return digest.hexdigest()
