"""Models on disk: complete or not at all, and never beside those of an earlier run."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pycolmap

    from mvmatch.types import StrPath

_PARTS = ("cameras", "frames", "images", "points3D", "rigs")
_LABEL = "mvmatch.txt"
"""Tells a model that a later run may replace or remove from those of others."""


def write_models(models: Sequence[pycolmap.Reconstruction], out: StrPath) -> list[Path]:
    """Write models to ``out/0``, ``out/1`` and so on, in the place of those of an earlier run.

    Of the earlier ones none is left, however few the new ones are. Other files in their folders,
    and models that bear no label of mvmatch, stay.

    Raises
    ------
    DataError
        The folder cannot be written.
    """
    out = Path(out)
    for path in _numbered(out):
        if int(path.name) >= len(models) and _is_ours(path):
            _remove_model(path)
    return [write_model(model, out, number) for number, model in enumerate(models)]


def write_model(model: pycolmap.Reconstruction, out: StrPath, number: int = 0) -> Path:
    """Write the model to ``out/0``, or another number; an older one there is replaced.

    Raises
    ------
    DataError
        The folder cannot be written.
    """
    out = Path(out)
    path, partial = out / str(number), out / f".{number}.partial"
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        model.write_binary(partial)
        if not _is_whole(partial, model):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        (partial / _LABEL).write_text(_label(path.name), encoding="utf-8")
        _remove_model(path)
        path.mkdir(exist_ok=True)
        for file in sorted(partial.iterdir(), reverse=True):  # no model before the last, cameras
            file.replace(path / file.name)
        partial.rmdir()
    except OSError as error:
        raise DataError(
            f"cannot write the model {path}: {error.strerror}; choose another folder"
        ) from error
    return path


def foreign_models(out: Path) -> list[Path]:
    """Return folders ``out/0``, ``out/1`` ... that hold a model which mvmatch did not write."""
    return [path for path in _numbered(out) if _files_of_model(path) and not _is_ours(path)]


def _numbered(out: Path) -> list[Path]:
    """Return the folders that bear the number of a model, in order."""
    if not out.is_dir():
        return []
    numbered = [path for path in out.iterdir() if path.name.isdecimal() and path.is_dir()]
    return sorted(numbered, key=lambda path: int(path.name))


def _label(name: str) -> str:
    return (
        f"Model {name} of the folder above, written by mvmatch. "
        "A later run into that folder replaces or removes it.\n"
    )


def _is_ours(folder: Path) -> bool:
    """Whether mvmatch wrote the model, here: a copy under another number is its owner's."""
    try:
        return (folder / _LABEL).read_text(encoding="utf-8") == _label(folder.name)
    except (OSError, UnicodeDecodeError):
        return False


def _files_of_model(folder: Path) -> list[Path]:
    files = [folder / f"{part}{suffix}" for part in _PARTS for suffix in (".bin", ".txt")]
    return [file for file in files if file.is_file()]


def _remove_model(folder: Path) -> None:
    """Remove the files of a model, and their folder if nothing else is in it."""
    for file in (*_files_of_model(folder), folder / _LABEL):
        file.unlink(missing_ok=True)
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def _is_whole(folder: Path, model: pycolmap.Reconstruction) -> bool:
    """Whether a model was written to its end: on a full disk COLMAP stops without a word."""
    import pycolmap

    try:
        written = pycolmap.Reconstruction(folder)
    except (RuntimeError, ValueError):
        return False
    return (
        written.num_reg_images() == model.num_reg_images()
        and written.num_points3D() == model.num_points3D()
        and written.compute_num_observations() == model.compute_num_observations()
    )


def check_database(path: Path) -> None:
    """Refuse what is no SQLite file.

    Raises
    ------
    DataError
        The file is none.
    FileNotFoundError
        There is no file.
    """
    with path.open("rb") as file:
        magic = file.read(16)
    if magic != b"SQLite format 3\0":
        raise DataError(f"{path} is not a COLMAP database (not an SQLite file)")
