"""Videos as cameras and phones write them: a model, or a refusal that says why."""

from __future__ import annotations

import dataclasses
import json
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from mvmatch.cli import main
from mvmatch.encode.svt import ordinary_scheduling
from mvmatch.store import read_tracks
from mvmatch.testing import synthetic_drive

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from _pytest.capture import CaptureFixture
    from numpy.typing import NDArray

    Pictures = Sequence[NDArray[np.uint8]]

pytest.importorskip("pycolmap")

MILLISECOND = Fraction(1, 1000)
SVT = {
    "preset": "8", "crf": "25", "svtav1-params": "pred-struct=1:rtc=1:hierarchical-levels=0",
}  # fmt: skip


@pytest.fixture(scope="module")
def drive(data: Path) -> Pictures:
    """Twenty pictures of 352x200, forward through a street; the camera is `camera()`."""
    import av

    with av.open(str(data / "drive.ivf")) as container:
        return [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]


def camera(left: int = 0, top: int = 0) -> str:
    """Camera of the drive, with columns and rows cut off on the left and at the top."""
    return f"PINHOLE,260.48,260.48,{176 - left},{100 - top}"


def write_video(
    path: Path,
    pictures: Pictures,
    *,
    times: Sequence[int] | None = None,
    codec: str = "ffv1",
    pixels: str = "yuv444p",
    rotation: int = 0,
    options: dict[str, str] | None = None,
) -> Path:
    """Write a video whose pictures are shown at ``times`` in ms, every 100 ms without."""
    import av

    height, width = pictures[0].shape[:2]
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(codec, rate=Fraction(10))
        stream.width, stream.height, stream.pix_fmt = width, height, pixels
        stream.options = options or {}
        stream.codec_context.time_base = MILLISECOND
        if rotation:
            stream.set_display_rotation(rotation)
        with ordinary_scheduling():
            container.start_encoding()
        for index, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
            frame = frame.reformat(format=pixels)
            frame.pts = 100 * index if times is None else times[index]
            frame.time_base = MILLISECOND
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def damage(clip: Path, packets: Sequence[int]) -> Path:
    """Overwrite the second half of packets of an IVF file."""
    stream, at, found = bytearray(clip.read_bytes()), 32, []
    while at < len(stream):
        size = int.from_bytes(stream[at : at + 4], "little")
        found.append((at + 12 + size // 2, at + 12 + size))
        at += 12 + size
    for start, stop in (found[packet] for packet in packets):
        stream[start:stop] = b"\x5a" * (stop - start)
    clip.write_bytes(stream)
    return clip


def run(clip: Path, out: Path, *words: str, code: int = 0) -> dict[str, Any]:
    """Run the command line; return its report."""
    if "--camera" not in words:
        words = ("--camera", camera(), *words)
    assert main(["run", str(clip), "-o", str(out), *words]) == code
    return json.loads((out / "report.json").read_text())


def warning(report: dict[str, Any], words: str) -> str:
    """Return the one warning that holds some words."""
    (found,) = [text for text in report["warnings"] if words in text]
    return found


def assert_whole(report: dict[str, Any]) -> None:
    model = report["model"]
    assert model["accepted"], model["reasons"]
    assert model["registered"] == model["total"] == report["input"]["num_frames"]


def test_a_portrait_video_is_modelled_as_stored_and_says_so(
    drive: Pictures, tmp_path: Path
) -> None:
    options = {"crf": "8"}
    clip = write_video(
        tmp_path / "phone.mp4", drive, codec="libx264", pixels="yuv420p", rotation=-90,
        options=options,
    )  # fmt: skip
    report = run(clip, tmp_path / "out")
    assert_whole(report)
    assert (report["input"]["width"], report["input"]["height"]) == (352, 200)
    assert "-90 degrees" in warning(report, "stored orientation")


def test_a_variable_frame_rate_keeps_its_times(drive: Pictures, tmp_path: Path) -> None:
    steps = [33, 33, 100, 33, 250, 1, 33, 66, 33, 2, 120, 33, 33, 400, 33, 33, 33, 33, 33]
    times = np.cumsum([0, *steps]).tolist()
    clip = write_video(tmp_path / "phone.mkv", drive, times=times)
    report = run(clip, tmp_path / "out")
    assert_whole(report)

    from mvmatch import open_video

    with open_video(tmp_path / "out" / "encoded.ivf") as video:
        list(video)
        shown = [frame.pts for frame in video.frames if frame.is_shown]
        assert video.info.frame_rate is None
    assert shown == pytest.approx(np.array(times) / 1000)


def test_an_odd_size_keeps_every_column_and_row(drive: Pictures, tmp_path: Path) -> None:
    pictures = [picture[:199, 15:336] for picture in drive]
    clip = write_video(tmp_path / "odd.mkv", pictures)
    report = run(clip, tmp_path / "out", "--camera", camera(left=15))
    assert_whole(report)
    assert (report["input"]["width"], report["input"]["height"]) == (321, 199)


@pytest.mark.parametrize("pixels", ["yuv420p10le", "yuv422p10le"])
def test_ten_bits_are_no_obstacle(pixels: str, drive: Pictures, tmp_path: Path) -> None:
    clip = write_video(tmp_path / "ten.mkv", drive, pixels=pixels)
    assert_whole(run(clip, tmp_path / "out"))


def test_repeated_pictures_are_counted_and_do_no_harm(drive: Pictures, tmp_path: Path) -> None:
    """Three in ten pictures show the one before them again."""
    pictures = [
        p for index, p in enumerate(drive[:14]) for p in [p] * (1 + (index % 7 in (1, 3, 5)))
    ]
    assert len(pictures) == 20
    clip = write_video(tmp_path / "repeats.mkv", pictures)
    report = run(clip, tmp_path / "out")
    assert_whole(report)
    assert report["footage"]["repeats"] == [2, 5, 8, 12, 15, 18]
    assert "6 in all" in warning(report, "show the one before them again")


def test_a_camera_that_stands_is_refused(
    drive: Pictures, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    noise = np.random.default_rng(0).normal(0, 2, (12, *drive[0].shape))
    pictures = [np.clip(drive[0] + each, 0, 255).astype(np.uint8) for each in noise]
    clip = write_video(tmp_path / "static.mkv", pictures)
    report = run(clip, tmp_path / "out", code=1)
    assert "the camera does not move" in report["model"]["reasons"][0]
    assert "the camera does not move" in capsys.readouterr().err
    assert not (tmp_path / "out" / "sparse").exists()


def test_a_camera_that_only_turns_is_refused(tmp_path: Path, capsys: CaptureFixture[str]) -> None:
    scene = synthetic_drive(1, (320, 240))
    pose = scene.cam_from_world[0]
    angles = 0.02 * np.arange(12)
    turns = np.zeros((12, 3, 3))
    turns[:, 1, 1] = 1
    turns[:, 0, 0] = turns[:, 2, 2] = np.cos(angles)
    turns[:, 0, 2], turns[:, 2, 0] = np.sin(angles), -np.sin(angles)
    scene = dataclasses.replace(scene, cam_from_world=turns @ pose)
    clip = write_video(tmp_path / "turn.mkv", [scene.render(frame) for frame in range(12)])
    focal = scene.K[0, 0]
    report = run(clip, tmp_path / "out", "--camera", f"PINHOLE,{focal},{focal},160,120", code=1)
    assert "the camera only turns" in report["model"]["reasons"][0]
    assert "the camera only turns" in capsys.readouterr().err


def test_ten_frames_are_enough(drive: Pictures, tmp_path: Path) -> None:
    clip = write_video(tmp_path / "short.mkv", drive[:10])
    assert_whole(run(clip, tmp_path / "out"))


@pytest.mark.parametrize("codec", ["ffv1", "libsvtav1"])
def test_of_two_shots_the_longer_one_is_modelled(
    codec: str, drive: Pictures, tmp_path: Path
) -> None:
    """A cut in a video of another codec, and one at a key frame of an AV1 video."""
    pictures = [*drive[:14], *(picture[::-1] for picture in drive[19:13:-1])]
    name, pixels, options = "cut.mkv", "yuv444p", {}
    if codec == "libsvtav1":
        name, pixels, options = "cut.ivf", "yuv420p", {**SVT, "g": "14"}
    clip = write_video(tmp_path / name, pictures, codec=codec, pixels=pixels, options=options)
    report = run(clip, tmp_path / "out", code=1)
    assert report["model"]["accepted"], report["model"]["reasons"]
    assert (report["model"]["registered"], report["model"]["total"]) == (14, 20)
    assert report["model"]["status"] == "partial"
    why, missing = report["model"]["findings"]
    assert why["code"] == ("key-frame" if codec == "libsvtav1" else "scene-cut")
    assert (why["frames"], missing["frames"]) == ([[14, 14]], [[14, 19]])
    assert report["footage"]["breaks"] == [14]
    assert "14" in warning(report, "each model holds one")


def test_a_calibration_of_opencv_at_twice_the_size_fits_the_drive(
    data: Path, tmp_path: Path
) -> None:
    cv2 = pytest.importorskip("cv2")
    path = tmp_path / "calibration.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 704)
    storage.write("image_height", 400)
    # Twice the camera of the drive, less half a pixel: OpenCV's origin.
    storage.write("camera_matrix", np.array([[520.96, 0, 351.5], [0, 520.96, 199.5], [0, 0, 1]]))
    storage.write("distortion_coefficients", np.zeros((1, 5)))
    storage.release()
    report = run(data / "drive.ivf", tmp_path / "out", "--camera", str(path))
    assert_whole(report)
    assert report["camera"]["params"] == pytest.approx([260.48, 260.48, 176, 100])
    assert "704x400 pictures and was scaled to 352x200" in warning(report, "calibration.yml")


def test_a_damaged_stretch_leaves_the_longest_part(drive: Pictures, tmp_path: Path) -> None:
    clip = write_video(
        tmp_path / "damaged.ivf", drive, codec="libsvtav1", pixels="yuv420p",
        options={**SVT, "g": "10"},
    )  # fmt: skip
    damage(clip, [5, 6])
    report = run(clip, tmp_path / "out", "--errors", "resume", code=1)
    assert report["damage"] is None
    assert {"code": "damage", "frames": [[5, 9]]}.items() <= report["model"]["findings"][1].items()
    assert report["skipped"][0]["after_frame"] == 5
    assert warning(report, "A part of the stream was skipped")
    assert report["model"]["accepted"], report["model"]["reasons"]
    assert report["model"]["registered"] >= 10
    assert "5 to 10" in warning(report, "No track goes on into the pictures")
    tracks = read_tracks(tmp_path / "out" / "tracks.parquet").tracks
    assert not set(tracks.frame.tolist()) & {5, 6, 7, 8, 9}


def test_damage_in_another_codec_loses_only_what_cannot_be_decoded(
    drive: Pictures, tmp_path: Path
) -> None:
    import av

    clip = write_video(
        tmp_path / "damaged.mp4", drive, codec="libx264", pixels="yuv420p",
        options={"crf": "12", "g": "5"},
    )  # fmt: skip
    with av.open(str(clip)) as container:
        places = [(p.pos, p.size) for p in container.demux(video=0) if p.size and p.pos is not None]
    stream = bytearray(clip.read_bytes())
    for start, size in places[8:10]:
        stream[start + 10 : start + size] = b"\x5a" * (size - 10)
    clip.write_bytes(stream)

    report = run(clip, tmp_path / "out")
    assert_whole(report)
    assert 15 <= report["input"]["num_frames"] < 20
    assert f"{report['input']['num_frames']} frames were encoded" in warning(report, "damaged in")
