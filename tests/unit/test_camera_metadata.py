"""What pictures and videos recorded of their own camera, and cameras that need care."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from mvmatch.camera import parse_camera
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("pycolmap")

FULL_FRAME = 43.27
"""Diagonal in mm."""
POINTS = np.random.default_rng(1).uniform((-0.2, -0.2, 1), (0.2, 0.2, 1), (30, 3))


def write_photo(path: Path, millimetres: float | None, size: tuple[int, int] = (64, 48)) -> Path:
    image = pytest.importorskip("PIL.Image")
    exif = image.Exif()
    if millimetres is not None:
        exif.get_ifd(0x8769)[0xA405] = millimetres  # FocalLengthIn35mmFilm
    image.new("RGB", size).save(path, exif=exif)
    return path


def write_clip(
    path: Path,
    *,
    rotation: int = 0,
    facts: dict[str, str] | None = None,
    size: tuple[int, int] = (64, 48),
) -> Path:
    import av

    with av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as container:
        container.metadata.update(facts or {})
        stream: Any = container.add_stream("mpeg4", rate=Fraction(10))
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        if rotation:
            stream.set_display_rotation(rotation)
        for index in range(3):
            pixels = np.full((size[1], size[0], 3), 40 * index, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
        container.mux(stream.encode())
    return path


def test_a_photo_gives_its_focal_length_as_a_prior(tmp_path: Path) -> None:
    photo = write_photo(tmp_path / "photo.jpg", 28)
    choice = parse_camera(str(photo), 640, 480)
    assert choice.is_prior
    assert not choice.camera.has_prior_focal_length  # so the mapper refines it
    assert choice.camera.mean_focal_length() == pytest.approx(28 / FULL_FRAME * 800)
    assert "EXIF of photo.jpg" in choice.source


def test_a_folder_of_frames_is_asked_when_nobody_gave_a_camera(tmp_path: Path) -> None:
    for name in ("1.jpg", "2.jpg"):
        write_photo(tmp_path / name, 35)
    expected = 35 / FULL_FRAME * 80
    for choice in (
        parse_camera(None, 64, 48, pictures=tmp_path),
        parse_camera(str(tmp_path), 64, 48),
    ):
        assert choice.is_prior
        assert choice.camera.mean_focal_length() == pytest.approx(expected)


def test_frames_of_a_zoom_have_no_one_camera(tmp_path: Path) -> None:
    write_photo(tmp_path / "1.jpg", 28)
    write_photo(tmp_path / "2.jpg", 70)
    with pytest.raises(DataError, match=r"1\.jpg and 2\.jpg have different focal lengths"):
        parse_camera(None, 64, 48, pictures=tmp_path)


@pytest.mark.parametrize("millimetres", [None, 0])
def test_without_a_recorded_focal_length_the_prior_is_as_ever(
    millimetres: int | None, tmp_path: Path
) -> None:
    photo = write_photo(tmp_path / "1.jpg", millimetres)
    choice = parse_camera(None, 64, 48, pictures=tmp_path)
    assert choice.camera.params.tolist() == [1.2 * 64, 32.0, 24.0, 0.0]
    with pytest.raises(DataError, match="has recorded no focal length"):
        parse_camera(str(photo), 64, 48)


def test_what_is_no_picture_has_recorded_nothing(tmp_path: Path) -> None:
    for name in ("broken.jpg", "broken.mp4"):
        path = tmp_path / name
        path.write_bytes(b"no picture")
        with pytest.raises(DataError, match="has recorded no focal length"):
            parse_camera(str(path), 64, 48)
        assert parse_camera(None, 64, 48, pictures=path).source.endswith("1.2 x the longer side")


def test_a_video_of_a_phone_gives_its_focal_length_as_a_prior(tmp_path: Path) -> None:
    key = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
    clip = write_clip(tmp_path / "clip.mov", facts={key: "26"})
    choice = parse_camera(None, 64, 48, pictures=clip)
    assert choice.is_prior
    assert choice.camera.mean_focal_length() == pytest.approx(26 / FULL_FRAME * 80)
    assert "26 mm" in choice.source

    for nonsense in ("-26", "nan", "wide"):
        clip = write_clip(tmp_path / "clip.mov", facts={key: nonsense})
        assert "1.2 x" in parse_camera(None, 64, 48, pictures=clip).source


@pytest.mark.parametrize("rotation", [90, -90])
@pytest.mark.parametrize(
    "camera",
    [
        "OPENCV 48 64 60 61 20 30 -0.1 0.02 0.003 -0.004",
        "FULL_OPENCV 48 64 60 61 20 30 -0.1 0.02 0.003 -0.004 0.01 0.02 0.03 0.04",
        "SIMPLE_RADIAL 96 128 120 40 60 0.1",
    ],
)
def test_an_upright_camera_is_turned_to_how_the_video_is_stored(
    camera: str, rotation: int, tmp_path: Path
) -> None:
    clip = write_clip(tmp_path / "clip.mp4", rotation=rotation)
    import av

    with av.open(str(clip)) as container:
        shown = next(container.decode(video=0)).rotation
    assert shown == rotation

    choice = parse_camera(camera, 64, 48, pictures=clip)
    assert "turned to the pictures as they are stored" in choice.warnings[0]
    upright = parse_camera(camera, 48, 64).camera
    # Players turn stored pictures counter-clockwise by `rotation`, the world seen with them.
    x, y, z = POINTS.T
    turn = 1 if rotation == 90 else -1
    found = choice.camera.img_from_cam(np.column_stack([-turn * y, turn * x, z]))
    u, v = np.asarray(upright.img_from_cam(POINTS), np.float64).T
    expected = (64 - v, u) if rotation == 90 else (v, 48 - u)
    np.testing.assert_allclose(found, np.column_stack(expected), atol=1e-9)


def test_an_upright_camera_of_an_unturned_video_is_refused(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "clip.mp4")
    with pytest.raises(DataError, match="lying on its side"):
        parse_camera("PINHOLE 48 64 60 60 24 32", 64, 48, pictures=clip)


def test_a_camera_that_cannot_be_turned_is_refused(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "clip.mp4", rotation=90)
    camera = "THIN_PRISM_FISHEYE 48 64 60 60 24 32 0 0 0 0 0 0 0.1 0"
    with pytest.raises(DataError, match="cannot be turned"):
        parse_camera(camera, 64, 48, pictures=clip)


def test_a_narrow_fisheye_is_used_and_a_wide_one_warned_of() -> None:
    narrow = parse_camera("OPENCV_FISHEYE,500,500,320,240,0,0,0,0", 640, 480)
    assert narrow.warnings == ()
    (warning,) = parse_camera("OPENCV_FISHEYE,150,150,320,240,0,0,0,0", 640, 480).warnings
    assert "more than 80 degrees off the axis" in warning
    assert "undistort" in warning


def test_a_spherical_camera_is_refused() -> None:
    with pytest.raises(DataError, match="spherical"):
        parse_camera("EQUIRECTANGULAR 640 320", 640, 320)
