"""A model on disk: complete or not at all."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import errno
import os
import shutil
from typing import TYPE_CHECKING

from mvmatch.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path

    import pycolmap


def write_model(model: pycolmap.Reconstruction, out: Path, number: int = 0) -> Path:
    """Write the model to ``out/0``, or another number; an older one there is replaced.

    Raises
    ------
    DataError
        The folder cannot be written.
    """
    path, partial = out / str(number), out / f".{number}.partial"
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        model.write_binary(partial)
        if not _is_whole(partial, model):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        shutil.rmtree(path, ignore_errors=True)
        partial.replace(path)
    except OSError as error:
        raise DataError(
            f"cannot write the model {path}: {error.strerror}; choose another folder"
        ) from error
    return path


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
