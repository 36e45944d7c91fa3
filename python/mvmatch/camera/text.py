"""Cameras in plain text: COLMAP's strings and files, KITTI's calibration."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from mvmatch.camera.calibration import HALF_PIXEL, Calibration, whole_size
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path


def looks_like_colmap(text: str) -> bool:
    """Whether a text begins with a COLMAP model, or a number (its camera id) and a model."""
    import pycolmap

    tokens = _tokens(text)
    if len(tokens) > 1 and tokens[0].isdigit():
        tokens = tokens[1:]
    known = pycolmap.CameraModelId.__members__
    return len(tokens) > 1 and tokens[0].upper() in known and tokens[0].upper() != "INVALID"


def read_colmap(text: str, *, source: str) -> Calibration:
    """Read a COLMAP camera string or a line of ``cameras.txt``.

    Raises
    ------
    DataError
        Its parameters are no numbers, or not as many as the model has.
    """
    import pycolmap

    tokens = _tokens(text)
    if tokens[0].isdigit():  # the camera id of a cameras.txt line
        tokens = tokens[1:]
    name = tokens[0].upper()
    try:
        values = [float(token) for token in tokens[1:]]
    except ValueError as error:
        raise DataError(f"camera parameters must be numbers: {' '.join(tokens)!r}") from error
    example = pycolmap.Camera.create_from_model_name(1, name, 1.0, 1, 1)
    expected = len(example.params)
    source = f"{source} ({name})"
    if len(values) == expected:
        return Calibration(model=name, params=values, size=None, source=source)
    if len(values) == expected + 2:
        size = whole_size(values[0], values[1], source)
        return Calibration(model=name, params=values[2:], size=size, source=source)
    raise DataError(
        f"{name} takes {expected} parameters ({example.params_info}), with width and height before "
        f"them or without; got {len(values)} numbers"
    )


def read_lines(path: Path, text: str) -> Calibration | None:
    """Read a COLMAP camera file or a KITTI calibration; None when it is neither.

    Raises
    ------
    DataError
        The file holds several cameras, or one that :func:`read_colmap` refuses.
    """
    lines = [line.strip() for line in text.splitlines()]
    lines = [line for line in lines if line and not line.startswith("#")]
    cameras = [line for line in lines if looks_like_colmap(line)]
    if len(cameras) > 1:
        raise DataError(f"camera file {path} holds {len(cameras)} cameras; keep one")
    if cameras:
        return read_colmap(cameras[0], source=f"COLMAP camera {path.name}")
    row = _kitti_row(lines)
    if row is None:
        return None
    fx, _, cx, _, _, fy, cy = row[:7]
    return Calibration(
        model="PINHOLE",
        params=[fx, fy, cx + HALF_PIXEL, cy + HALF_PIXEL],
        size=None,
        source=f"KITTI calibration {path.name}",
    )


def is_number(text: str) -> bool:
    """Whether a text is one number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _kitti_row(lines: list[str]) -> list[float] | None:
    """Return the left camera's 3x4 projection: the row named P0, else P2, else the first row."""
    rows: dict[str, list[float]] = {}
    for line in lines:
        name, _, values = line.rpartition(":")
        numbers = values.split()
        if len(numbers) == 12 and all(is_number(number) for number in numbers):
            rows.setdefault(name.strip() or "first", [float(number) for number in numbers])
    for name in ("P0", "P_rect_00", "P2", "P_rect_02", "first"):
        if name in rows:
            row = rows[name]
            return row if row[0] > 0 and row[5] > 0 else None
    return None


def _tokens(text: str) -> list[str]:
    return [token for token in re.split(r"[,\s]+", text) if token]
