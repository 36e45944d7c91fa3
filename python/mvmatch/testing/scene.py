"""A static scene of textured rectangles, a camera path, and the exact truth between frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.testing.texture import texture

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_NEAR = 0.2
_OCCLUSION_TOLERANCE = 1e-6
_SUPERSAMPLING = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Rectangle:
    """A flat rectangle in the world, visible from both sides."""

    corner: NDArray[np.float64]
    """(3,) m, world."""
    side_u: NDArray[np.float64]
    """(3,) m: from the corner along the first side; orthogonal to ``side_v``."""
    side_v: NDArray[np.float64]
    """(3,) m: from the corner along the second side."""
    texture: str
    """Kind for :func:`mvmatch.testing.texture.texture`."""
    seed: int
    tint: tuple[float, float, float]
    """Mean colour, 0 to 255, red green blue."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SyntheticScene:
    """Rectangles seen by a pinhole camera that moves; pixel centres are at (0.5, 0.5).

    World and camera axes follow COLMAP: x right, y down, z forward.
    """

    rectangles: tuple[Rectangle, ...]
    width: int
    """px."""
    height: int
    """px."""
    K: NDArray[np.float64]
    """(3, 3) camera matrix, px."""
    cam_from_world: NDArray[np.float64]
    """(F, 3, 4) rotation and translation in m of each frame."""
    noise: float = 1.0
    """Standard deviation of the sensor noise in grey levels."""

    @property
    def num_frames(self) -> int:
        """Number of frames."""
        return len(self.cam_from_world)

    @property
    def centers(self) -> NDArray[np.float64]:
        """(F, 3) camera centres in m, world."""
        rotation, translation = self.cam_from_world[:, :, :3], self.cam_from_world[:, :, 3]
        return -np.einsum("fji,fj->fi", rotation, translation)

    @property
    def path_length(self) -> float:
        """Length of the camera's path in m."""
        return float(np.linalg.norm(np.diff(self.centers, axis=0), axis=1).sum())

    def surface(self, frame: int, xy: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Find what is visible at points of a frame.

        Parameters
        ----------
        frame : frame number.
        xy : (N, 2) px.

        Returns
        -------
        rectangle : (N,) index of the nearest rectangle, -1 for the sky.
        point : (N, 3) m, world; NaN for the sky.
        """
        xy = np.asarray(xy, np.float64)
        pixels = np.column_stack([xy, np.ones(len(xy))])
        rectangle = np.full(len(xy), -1, np.int64)
        nearness = np.zeros(len(xy))
        point = np.full((len(xy), 3), np.nan)
        for index, shape in enumerate(self.rectangles):
            inverse = self._plane_from_pixel(frame, shape)
            if inverse is None:
                continue
            u, v, w = inverse @ pixels.T
            hit = _inside(u, v, w) & (w > nearness)
            rectangle[hit], nearness[hit] = index, w[hit]
            point[hit] = (
                shape.corner
                + (u[hit] / w[hit])[:, None] * shape.side_u
                + (v[hit] / w[hit])[:, None] * shape.side_v
            )
        return rectangle, point

    def project(
        self, frame: int, points: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Project world points.

        Returns
        -------
        xy : (N, 2) px, meaningless behind the camera.
        depth : (N,) m along the optical axis.
        """
        pose = self.cam_from_world[frame]
        camera = np.asarray(points, np.float64) @ pose[:, :3].T + pose[:, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            image = camera @ self.K.T / camera[:, 2:]
        return image[:, :2], camera[:, 2]

    def transfer(
        self, frame: int, other: int, xy: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Find where points of a frame lie in another frame.

        Parameters
        ----------
        frame, other : frame numbers.
        xy : (N, 2) px in ``frame``.

        Returns
        -------
        xy_other : (N, 2) px in ``other``, NaN for the sky.
        visible : (N,) whether the point lies inside the other picture and nothing hides it.
        """
        _, point = self.surface(frame, xy)
        target, depth = self.project(other, point)
        inside = (depth > _NEAR) & (target >= 0).all(axis=1)
        inside &= (target < (self.width, self.height)).all(axis=1)
        visible = np.zeros(len(target), np.bool_)
        _, seen = self.surface(other, target[inside])
        _, seen_depth = self.project(other, seen)
        visible[inside] = seen_depth > depth[inside] * (1 - _OCCLUSION_TOLERANCE)
        target[~(depth > 0)] = np.nan
        return target, visible

    def render(self, frame: int) -> NDArray[np.uint8]:
        """Return (height, width, 3) red green blue; the same picture every time."""
        scale = _SUPERSAMPLING
        shape = (self.height * scale, self.width * scale)
        index, nearness = self._depth_buffer(frame, shape)
        colour = _sky(shape)
        order = np.argsort(index, axis=None, kind="stable")
        bounds = np.searchsorted(index.ravel()[order], np.arange(len(self.rectangles) + 1))
        for number, rectangle in enumerate(self.rectangles):
            samples = order[bounds[number] : bounds[number + 1]]
            if len(samples):
                rows, columns = np.divmod(samples, shape[1])
                grey = self._shade(frame, rectangle, rows, columns, nearness[rows, columns])
                colour[rows, columns] = grey[:, None] * np.asarray(rectangle.tint, np.float32)
        offsets = [(row, column) for row in range(scale) for column in range(scale)]
        picture = sum(colour[row::scale, column::scale] for row, column in offsets)
        picture = picture / np.float32(scale**2)
        rng = np.random.default_rng((7919, frame))
        noise = rng.normal(0.0, self.noise, (self.height, self.width, 1))
        picture = picture + noise.astype(np.float32)
        return np.clip(np.rint(picture), 0, 255).astype(np.uint8)

    def _plane_from_pixel(self, frame: int, shape: Rectangle) -> NDArray[np.float64] | None:
        """Return (3, 3) H with H (x, y, 1) = (u, v, 1) / depth, sides counted 0 to 1."""
        pose = self.cam_from_world[frame]
        origin = pose[:, :3] @ shape.corner + pose[:, 3]
        pixel_from_plane = self.K @ np.column_stack(
            [pose[:, :3] @ shape.side_u, pose[:, :3] @ shape.side_v, origin]
        )
        if abs(np.linalg.det(pixel_from_plane)) < 1e-9:
            return None  # seen exactly from the side
        return np.linalg.inv(pixel_from_plane).astype(np.float64)

    def _depth_buffer(
        self, frame: int, shape: tuple[int, int]
    ) -> tuple[NDArray[np.int16], NDArray[np.float64]]:
        """Return rectangle index (-1 sky) and 1 / depth of every sample."""
        index = np.full(shape, -1, np.int16)
        nearness = np.zeros(shape)
        for number, rectangle in enumerate(self.rectangles):
            inverse = self._plane_from_pixel(frame, rectangle)
            box = self._bounding_box(frame, rectangle, shape)
            if inverse is None or box is None:
                continue
            y = (np.arange(box[1], box[3])[:, None] + 0.5) / _SUPERSAMPLING
            x = (np.arange(box[0], box[2])[None, :] + 0.5) / _SUPERSAMPLING
            u, v, w = (row[0] * x + row[1] * y + row[2] for row in inverse)
            part = np.s_[box[1] : box[3], box[0] : box[2]]
            hit = _inside(u, v, w) & (w > nearness[part])
            nearness[part][hit] = w[hit]
            index[part][hit] = number
        return index, nearness

    def _bounding_box(
        self, frame: int, rectangle: Rectangle, shape: tuple[int, int]
    ) -> tuple[int, int, int, int] | None:
        """Return samples x0, y0, x1, y1 that may show a rectangle; None when it is out of sight."""
        corners = rectangle.corner + np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) @ np.stack(
            [rectangle.side_u, rectangle.side_v]
        )
        xy, depth = self.project(frame, corners)
        if (depth < _NEAR).all():
            return None
        if (depth < _NEAR).any():
            return 0, 0, shape[1], shape[0]
        low = np.clip(np.floor(xy.min(axis=0) * _SUPERSAMPLING), 0, shape[::-1]).astype(int)
        high = np.clip(np.ceil(xy.max(axis=0) * _SUPERSAMPLING), 0, shape[::-1]).astype(int)
        return (low[0], low[1], high[0], high[1]) if (low < high).all() else None

    def _shade(
        self,
        frame: int,
        rectangle: Rectangle,
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
        nearness: NDArray[np.float64],
    ) -> NDArray[np.float32]:
        """Texture values of samples that show a rectangle."""
        inverse = self._plane_from_pixel(frame, rectangle)
        assert inverse is not None
        x, y = (columns + 0.5) / _SUPERSAMPLING, (rows + 0.5) / _SUPERSAMPLING
        length_u = float(np.linalg.norm(rectangle.side_u))
        length_v = float(np.linalg.norm(rectangle.side_v))
        u = (inverse[0, 0] * x + inverse[0, 1] * y + inverse[0, 2]) / nearness * length_u
        v = (inverse[1, 0] * x + inverse[1, 1] * y + inverse[1, 2]) / nearness * length_v
        # Area on the surface per sample: determinant of the homography's derivative.
        area = abs(np.linalg.det(inverse)) * length_u * length_v / nearness**3
        footprint = np.sqrt(area) / _SUPERSAMPLING
        return texture(rectangle.texture, rectangle.seed).sample(u, v, footprint)


def _inside(
    u: NDArray[np.float64], v: NDArray[np.float64], w: NDArray[np.float64]
) -> NDArray[np.bool_]:
    return (w > 0) & (w < 1 / _NEAR) & (u >= 0) & (u <= w) & (v >= 0) & (v <= w)


def _sky(shape: tuple[int, int]) -> NDArray[np.float32]:
    """Smooth gradient: no texture, as in real skies."""
    height = np.linspace(0, 1, shape[0], dtype=np.float32)[:, None, None]
    top, horizon = np.array([120, 160, 215], np.float32), np.array([225, 230, 235], np.float32)
    sky = np.broadcast_to(top + (horizon - top) * height, (*shape, 3))
    return sky.astype(np.float32)
