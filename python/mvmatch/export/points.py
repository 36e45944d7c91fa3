"""Points of COLMAP models as PLY."""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.errors import DataError
from mvmatch.export.files import write_file

if TYPE_CHECKING:
    import pycolmap

    from mvmatch.types import StrPath

_PROPERTIES = (
    ("x", "float", "<f4"),
    ("y", "float", "<f4"),
    ("z", "float", "<f4"),
    ("red", "uchar", "u1"),
    ("green", "uchar", "u1"),
    ("blue", "uchar", "u1"),
    ("error", "float", "<f4"),
    ("track_length", "float", "<f4"),
)
"""Name, type in PLY, type in NumPy; the first six are those of COLMAP's own export. COLMAP reads no
types but float, double and uchar; a float holds whole numbers up to 2^24."""


def write_ply(model: pycolmap.Reconstruction, path: StrPath) -> None:
    """Write position, colour, error and track length of every point as binary PLY.

    Vertices are in the order of the point ids. ``error`` is the mean reprojection error in px, -1
    where it is not known; ``track_length`` is the number of images that see the point.

    Parameters
    ----------
    model : pycolmap.Reconstruction
        With at least one point; positions in its units.
    path : path
        The file.

    Raises
    ------
    DataError
        There is no point, or the file cannot be written.
    """
    path = Path(path)
    points: Any = model.points3D
    if not points:
        raise DataError("the model has no points. Reconstruct anew, or export only its poses")
    rows = [
        (*point.xyz, *point.color, point.error, point.track.length())
        for _, point in sorted(points.items())
    ]
    vertices = np.array(rows, [(name, kind) for name, _, kind in _PROPERTIES])
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property {kind} {name}" for name, kind, _ in _PROPERTIES),
        "end_header\n",
    ]
    write_file(path, "\n".join(header).encode() + vertices.tobytes())
