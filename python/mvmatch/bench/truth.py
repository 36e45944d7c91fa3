"""Where points truly go: the interface, and rendered scenes with exact geometry.

The layout of a rendered scene (``scene.npz``): ``tri`` (T, 3, 3) triangles in object coordinates,
m; ``tri_obj`` (T,) object of each; ``obj_T`` (F, O, 4, 4) object to world; ``cam`` (F, 3, 4) camera
to world; ``K`` (3, 3) px; ``k1`` radial distortion (COLMAP's SIMPLE_RADIAL); ``size`` width and
height. A ray that hits nothing sees the sky at infinity.
"""

# embreex carries no types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportMissingImports=false

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from mvmatch.errors import DataError, MissingExtraError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

RELATIVE_TOLERANCE = 2e-4
ABSOLUTE_TOLERANCE = 5e-4
"""m; a point is hidden by what is nearer by more than this plus the relative share of its depth."""

_MOST_SCENES = 12
"""Ray-tracing structures kept; one per frame where objects move."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Targets:
    """Where points of one frame lie in another."""

    xy: NDArray[np.float64]
    """(N, 2) px, also where hidden or outside; NaN where there is no such place."""
    visible: NDArray[np.bool_]
    """(N,) inside the picture and not hidden."""
    moving: NDArray[np.bool_]
    """(N,) on something that moves by itself between the two frames."""


class Truth(Protocol):
    """Knows where every point of a sequence goes."""

    def targets(self, frame0: int, frame1: int, xy: ArrayLike) -> Targets:
        """Follow (N, 2) points, px, from one frame into another."""
        ...


class StillTruth:
    """One picture as all frames: every point stays."""

    def __init__(self, size: tuple[int, int]) -> None:
        self._size = size

    def targets(self, frame0: int, frame1: int, xy: ArrayLike) -> Targets:  # noqa: ARG002
        """Return the points themselves; visible inside the picture."""
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        visible = inside(points, self._size)
        return Targets(xy=points, visible=visible, moving=np.zeros(len(points), np.bool_))


@dataclass(kw_only=True, eq=False)
class RenderedTruth:
    """Exact geometry of a rendered scene: rays find the surface, its pose carries the point on.

    Embree decides in single precision which triangle is hit; positions come from the plane of that
    triangle in double precision.
    """

    triangles: NDArray[np.float64]
    """(T, 3, 3) m, object coordinates."""
    triangle_object: NDArray[np.int64]
    """(T,)"""
    world_from_object: NDArray[np.float64]
    """(F, O, 4, 4)"""
    world_from_cam: NDArray[np.float64]
    """(F, 3, 4)"""
    K: NDArray[np.float64]
    """(3, 3) px."""
    k1: float
    size: tuple[int, int]
    """Width and height, px."""
    _scenes: dict[int, tuple[Any, NDArray[np.float64], NDArray[np.float64]]] = field(
        default_factory=dict[int, "tuple[Any, NDArray[np.float64], NDArray[np.float64]]"]
    )

    @classmethod
    def load(cls, path: Path) -> RenderedTruth:
        """Read a ``scene.npz``.

        Raises
        ------
        DataError
            It is not one, or its arrays do not fit together.
        """
        try:
            with np.load(path, allow_pickle=False) as arrays:
                read = {name: np.asarray(arrays[name]) for name in _ARRAYS}
        except (OSError, ValueError, KeyError) as error:
            message = f"{path} is no scene with exact geometry ({error}); it needs {_ARRAYS}"
            raise DataError(message) from error
        frames, objects = read["obj_T"].shape[:2] if read["obj_T"].ndim == 4 else (-1, -1)
        count = len(read["tri_obj"]) if read["tri_obj"].ndim == 1 else -1
        shapes = {
            "tri": (count, 3, 3), "tri_obj": (count,), "obj_T": (frames, objects, 4, 4),
            "cam": (frames, 3, 4), "K": (3, 3), "k1": (), "size": (2,),
        }  # fmt: skip
        for name, shape in shapes.items():
            if read[name].shape != shape:
                message = f"{path}: {name} has the shape {read[name].shape}, not {shape}"
                raise DataError(message)
        if count < 1 or read["tri_obj"].min() < 0 or read["tri_obj"].max() >= objects:
            message = f"{path}: tri_obj names objects that obj_T does not have"
            raise DataError(message)
        return cls(
            triangles=read["tri"].astype(np.float64),
            triangle_object=read["tri_obj"].astype(np.int64),
            world_from_object=read["obj_T"].astype(np.float64),
            world_from_cam=read["cam"].astype(np.float64),
            K=read["K"].astype(np.float64),
            k1=float(read["k1"]),
            size=(int(read["size"][0]), int(read["size"][1])),
        )

    def targets(self, frame0: int, frame1: int, xy: ArrayLike) -> Targets:
        """Follow (N, 2) points, px, from one frame into another."""
        points = np.asarray(xy, np.float64).reshape(-1, 2)
        triangle, surface, _ = self._cast(frame0, points)
        sky = triangle < 0
        owner = self.triangle_object[np.maximum(triangle, 0)]
        before, after = self.world_from_object[frame0], self.world_from_object[frame1]
        same = (before == after).all(axis=(1, 2))
        motion = after @ np.linalg.inv(before)
        motion[same] = np.eye(4)
        start = np.where(sky[:, None], 0.0, surface)
        moved = np.einsum("nij,nj->ni", motion[owner, :3, :3], start) + motion[owner, :3, 3]
        pose = self.world_from_cam[frame1]
        _, directions = self._rays(frame0, points)
        in_cam = np.where(sky[:, None], directions, moved - pose[:, 3]) @ pose[:, :3]
        target = self._project(in_cam)
        visible = self._sees(frame1, target, np.where(sky, np.inf, in_cam[:, 2]))
        return Targets(xy=target, visible=visible, moving=~sky & ~same[owner])

    @property
    def still(self) -> NDArray[np.bool_]:
        """(O,) objects that never move."""
        return (self.world_from_object == self.world_from_object[:1]).all(axis=(0, 2, 3))

    def still_triangles(self) -> NDArray[np.float64]:
        """(S, 3, 3) triangles of what never moves, world, m."""
        return self._scene(0)[1][self.still[self.triangle_object]]

    def surface(
        self, frame: int, xy: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Find what is seen at (N, 2) points of a frame, px.

        Returns
        -------
        tuple
            World points (N, 3), m, NaN in the sky; depths (N,), m, infinite in the sky; and
            whether each lies on something that never moves (N,).
        """
        triangle, surface, depth = self._cast(frame, np.asarray(xy, np.float64).reshape(-1, 2))
        hit = triangle >= 0
        return surface, depth, hit & self.still[self.triangle_object[np.maximum(triangle, 0)]]

    def sees(self, frame: int, points: ArrayLike) -> NDArray[np.bool_]:
        """Mark (N, 3) points of the world, m, inside the picture of a frame and not hidden."""
        pose = self.world_from_cam[frame]
        in_cam = (np.asarray(points, np.float64).reshape(-1, 3) - pose[:, 3]) @ pose[:, :3]
        return self._sees(frame, self._project(in_cam), in_cam[:, 2])

    def _sees(
        self, frame: int, xy: NDArray[np.float64], depth: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Mark projections (N, 2) inside the picture that nothing nearer than (N,) depth hides."""
        visible = inside(xy, self.size)
        (rows,) = np.nonzero(visible)
        if len(rows):
            seen = self._cast(frame, xy[rows])[2]
            nearest = depth[rows] * (1 - RELATIVE_TOLERANCE) - ABSOLUTE_TOLERANCE
            visible[rows] = seen >= nearest
        return visible

    def _rays(
        self, frame: int, xy: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Camera centre (3,) and world directions (N, 3) of unit depth."""
        distorted = (xy - self.K[:2, 2]) / np.array([self.K[0, 0], self.K[1, 1]])
        plane = distorted.copy()
        for _ in range(30 if self.k1 else 0):
            plane = distorted / (1 + self.k1 * (plane**2).sum(axis=1, keepdims=True))
        pose = self.world_from_cam[frame]
        return pose[:, 3], np.column_stack([plane, np.ones(len(plane))]) @ pose[:, :3].T

    def _project(self, in_cam: NDArray[np.float64]) -> NDArray[np.float64]:
        ahead = np.where(in_cam[:, 2:] > 1e-9, in_cam[:, 2:], np.nan)
        plane = in_cam[:, :2] / ahead
        plane = plane * (1 + self.k1 * (plane**2).sum(axis=1, keepdims=True))
        return plane * np.array([self.K[0, 0], self.K[1, 1]]) + self.K[:2, 2]

    def _cast(
        self, frame: int, xy: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """First surface behind points: triangle (-1 is sky), world point, depth along the axis."""
        center, directions = self._rays(frame, xy)
        embree, triangles, normals = self._scene(frame)
        origins = np.ascontiguousarray(np.broadcast_to(center, directions.shape), np.float32)
        found = embree.run(origins, directions.astype(np.float32), query="INTERSECT")
        triangle = np.asarray(found).astype(np.int64)
        hit, index = triangle >= 0, np.maximum(triangle, 0)
        with np.errstate(all="ignore"):
            depth = np.einsum("ni,ni->n", triangles[index, 0] - center, normals[index])
            depth = depth / np.einsum("ni,ni->n", directions, normals[index])
        depth = np.where(hit, depth, np.inf)
        surface = center + directions * np.where(hit, depth, 0.0)[:, None]
        return triangle, np.where(hit[:, None], surface, np.nan), depth

    def _scene(self, frame: int) -> tuple[Any, NDArray[np.float64], NDArray[np.float64]]:
        """Ray-tracing structure, world triangles (T, 3, 3) and their normals (T, 3) of a frame."""
        if (self.world_from_object == self.world_from_object[:1]).all():
            frame = 0
        if frame not in self._scenes:
            if len(self._scenes) >= _MOST_SCENES:
                del self._scenes[next(iter(self._scenes))]
            pose = self.world_from_object[frame][self.triangle_object]
            world = np.einsum("tij,tvj->tvi", pose[:, :3, :3], self.triangles)
            world += pose[:, None, :3, 3]
            normals = np.cross(world[:, 1] - world[:, 0], world[:, 2] - world[:, 0])
            self._scenes[frame] = _embree_scene(world), world, normals
        return self._scenes[frame]


_ARRAYS = ("tri", "tri_obj", "obj_T", "cam", "K", "k1", "size")


def inside(xy: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.bool_]:
    """Mark (N, 2) points that lie in a picture; NaN does not."""
    return np.all((xy >= 0) & (xy <= np.asarray(size)), axis=1)


def _embree_scene(world: NDArray[np.float64]) -> Any:
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError as error:
        raise MissingExtraError(
            "the truth of rendered sequences needs embreex: pip install 'mvmatch[bench]'"
        ) from error
    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, world.astype(np.float32))
    return scene
