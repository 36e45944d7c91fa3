"""Fixtures of the unit tests."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

if TYPE_CHECKING:
    from pathlib import Path

SIZE = (160, 120)
"""px."""

PINHOLE = ("PINHOLE", [150.0, 148.0, 81.0, 59.0])


@pytest.fixture(scope="session")
def make_drive():
    """Function that renders a drive into a folder, in the layout of KITTI."""
    cv2 = pytest.importorskip("cv2")

    def make(folder: Path, num_frames: int, size: tuple[int, int] = (320, 180)) -> Path:
        from mvmatch.testing import synthetic_drive

        (folder / "images").mkdir(parents=True)
        scene = synthetic_drive(num_frames, size)
        for frame in range(scene.num_frames):
            image = scene.render(frame)[:, :, ::-1]
            cv2.imwrite(str(folder / "images" / f"{frame:06d}.png"), image)
        R = scene.cam_from_world[:, :, :3]
        poses = np.concatenate([R.transpose(0, 2, 1), scene.centers[:, :, None]], axis=2)
        np.savetxt(folder / "poses.txt", poses.reshape(-1, 12))
        fx, fy, cx, cy = scene.K[[0, 1, 0, 1], [0, 1, 2, 2]]
        camera = f"1 PINHOLE {size[0]} {size[1]} {fx} {fy} {cx} {cy}\n"
        (folder / "camera.txt").write_text(camera)
        return folder

    return make


@pytest.fixture
def make_model():
    """Function that makes a COLMAP model of points seen by a camera that moves and turns."""
    pycolmap = pytest.importorskip("pycolmap")

    def make(
        names=tuple(f"frame_{frame:06d}.png" for frame in range(6)),
        *,
        cameras=(PINHOLE,),
        num_points=40,
        size=SIZE,
    ) -> Any:
        generator = np.random.default_rng(5)
        model = pycolmap.Reconstruction()
        for number, (kind, params) in enumerate(cameras, start=1):
            model.add_camera_with_trivial_rig(
                pycolmap.Camera(
                    camera_id=number, model=kind, width=size[0], height=size[1], params=params
                )
            )
        points = generator.uniform([-1.2, -0.9, 4], [1.2, 0.9, 7], (num_points, 3))
        for index, name in enumerate(names):
            turn = pycolmap.Rotation3d(0.03 * generator.normal(size=3))
            pose = pycolmap.Rigid3d(turn, np.array([0.05 * index, -0.02 * index, 0.01]))
            camera = model.camera(1 + index % len(cameras))
            image = pycolmap.Image(
                name=name,
                camera_id=camera.camera_id,
                image_id=index + 1,
                keypoints=camera.img_from_cam(pose * points),
            )
            model.add_image_with_trivial_frame(image, pose)
        for index, xyz in enumerate(points):
            # Every point is seen in three images in a row.
            first = 1 + index % max(len(names) - 2, 1)
            seen = [i for i in range(first, first + 3) if i <= len(names)]
            model.add_point3D(xyz, pycolmap.Track([pycolmap.TrackElement(i, index) for i in seen]))
        model.update_point_3d_errors()
        return model

    return make
