"""A short synthetic drive through a street."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.testing.scene import Rectangle, SyntheticScene

if TYPE_CHECKING:
    from numpy.typing import NDArray

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class _Look:
    """Surface of a rectangle."""

    kind: str
    seed: int
    tint: Vector


_STEP = 0.36  # m per frame: 13 km/h at 10 frames per s
_CAMERA_HEIGHT = 1.6
_STREET_END = 60.0
_GROUND_TINTS = ((118.0, 116.0, 112.0), (146.0, 140.0, 130.0))
_WALL_TINTS = (
    (168.0, 120.0, 96.0),
    (150.0, 150.0, 138.0),
    (176.0, 158.0, 120.0),
    (128.0, 140.0, 158.0),
    (160.0, 132.0, 132.0),
)
_BOX_TINTS = ((150.0, 62.0, 54.0), (66.0, 92.0, 140.0), (190.0, 186.0, 176.0), (84.0, 120.0, 84.0))


def synthetic_drive(
    num_frames: int = 40, size: tuple[int, int] = (640, 360), *, seed: int = 0
) -> SyntheticScene:
    """Build a street with houses, parked boxes and poles, and a slightly curved forward drive.

    Parameters
    ----------
    num_frames : frames of the drive, 0.36 m apart.
    size : width and height in px; the field of view stays about 68 degrees.
    seed : another street for another number.
    """
    width, height = size
    rng = np.random.default_rng(seed)
    focal = 0.74 * width
    K = np.array([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])
    end = _STREET_END + _STEP * num_frames
    shapes = [
        *_ground(end),
        _wall((-14, 0, end), (28, 0, 0), (0, -14, 0), _Look("windows", 5, _WALL_TINTS[1])),
    ]
    for side in (-1.0, 1.0):
        shapes += _houses(rng, side, end)
        shapes += _parked(rng, side, end)
    return SyntheticScene(
        rectangles=tuple(shapes),
        width=width,
        height=height,
        K=K,
        cam_from_world=_path(num_frames),
    )


def _path(num_frames: int) -> NDArray[np.float64]:
    """Forward with a gentle sway, heading along the path, small bobbing of the camera."""
    time = np.arange(num_frames, dtype=np.float64)
    z = _STEP * time
    x = 0.5 * np.sin(time / 11.0)
    y = -_CAMERA_HEIGHT + 0.02 * np.sin(time / 2.3)
    yaw = np.arctan2(0.5 / 11.0 * np.cos(time / 11.0), _STEP) + 0.02 * np.sin(time / 7.0)
    pitch = 0.006 * np.sin(time / 3.1) - 0.01
    poses = np.empty((num_frames, 3, 4))
    for index in range(num_frames):
        rotation = _rotation_x(-pitch[index]) @ _rotation_y(-yaw[index])
        center = np.array([x[index], y[index], z[index]])
        poses[index] = np.column_stack([rotation, -rotation @ center])
    return poses


def _ground(end: float) -> list[Rectangle]:
    """Road between two pavements; y = 0 is the ground and -y points up."""
    road = _wall((-5, 0, -5), (10, 0, 0), (0, 0, end + 5), _Look("noise", 1, _GROUND_TINTS[0]))
    pavements = [
        _wall((x, -0.12, -5), (9, 0, 0), (0, 0, end + 5), _Look("bricks", 2, _GROUND_TINTS[1]))
        for x in (-14.0, 5.0)
    ]
    curbs = [
        _wall((x, 0, -5), (0, 0, end + 5), (0, -0.12, 0), _Look("noise", 3, _GROUND_TINTS[1]))
        for x in (-5.0, 5.0)
    ]
    return [road, *pavements, *curbs]


def _houses(rng: np.random.Generator, side: float, end: float) -> list[Rectangle]:
    shapes: list[Rectangle] = []
    z, number = -4.0, 0
    while z < end:
        length = float(rng.uniform(6.0, 11.0))
        distance = side * float(rng.uniform(6.5, 9.5))
        height = float(rng.uniform(7.0, 14.0))
        kind = ("windows", "bricks", "windows")[number % 3]
        tint = _WALL_TINTS[int(rng.integers(len(_WALL_TINTS)))]
        seed = 10 + number % 4
        up, back = (0, -height, 0), (side * 8.0, 0, 0)
        shapes.append(_wall((distance, 0, z), (0, 0, length), up, _Look(kind, seed, tint)))
        shapes.append(_wall((distance, 0, z), back, up, _Look("bricks", seed + 4, tint)))
        z += length
        number += 1
    return shapes


def _parked(rng: np.random.Generator, side: float, end: float) -> list[Rectangle]:
    shapes: list[Rectangle] = []
    z = float(rng.uniform(3.0, 6.0))
    while z < end - 6:
        tint = _BOX_TINTS[int(rng.integers(len(_BOX_TINTS)))]
        if rng.uniform() < 0.7:
            near = side * float(rng.uniform(2.9, 3.3))
            shapes += _box(near, z, (side * 1.7, 1.4, 4.0), tint, int(rng.integers(20, 23)))
        else:
            shapes += _box(side * 5.2, z, (side * 0.3, 5.5, 0.3), (90.0, 84.0, 80.0), 24)
        z += float(rng.uniform(4.5, 10.0))
    return shapes


def _box(
    near: float,
    z: float,
    size: Vector,
    tint: Vector,
    seed: int,
) -> list[Rectangle]:
    """Faces of a box that a camera in the street can see: front, street side, back, top."""
    width, height, length = size
    up, across, along = (0, -height, 0), (width, 0, 0), (0, 0, length)
    return [
        _wall((near, 0, z), across, up, _Look("noise", seed, tint)),
        _wall((near, 0, z), along, up, _Look("bricks", seed, tint)),
        _wall((near, 0, z + length), across, up, _Look("noise", seed, tint)),
        _wall((near, -height, z), across, along, _Look("noise", seed + 1, tint)),
    ]


def _wall(corner: Vector, side_u: Vector, side_v: Vector, look: _Look) -> Rectangle:
    return Rectangle(
        corner=np.array(corner, np.float64),
        side_u=np.array(side_u, np.float64),
        side_v=np.array(side_v, np.float64),
        texture=look.kind,
        seed=look.seed,
        tint=look.tint,
    )


def _rotation_x(angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _rotation_y(angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
