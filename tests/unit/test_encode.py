"""Encoding for matching: what goes in, what comes out, and what is refused."""

from __future__ import annotations

import contextlib
import os
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from mvmatch.encode import EncodeOptions, available_encoders, encode_video
from mvmatch.encode.check import EncodingChecker
from mvmatch.encode.frames import natural_key, open_frames
from mvmatch.errors import DataError, UnsupportedError
from mvmatch.types import MotionFlags

NO_CHECK = EncodeOptions(check=False)
THREADS = Path("/proc/self/task")


def write_png(path: Path, width: int, height: int, shift: int = 0) -> None:
    import av

    x, y = np.meshgrid(np.arange(width) + shift, np.arange(height))
    grey = (128 + 60 * np.sin(x / 5.0) + 50 * np.sin(y / 3.0 + x / 9.0)).astype(np.uint8)
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(grey), format="gray")
    with av.open(str(path), "w", format="image2", options={"update": "1"}) as container:
        stream = container.add_stream("png", rate=1)
        stream.width, stream.height, stream.pix_fmt = width, height, "gray"
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Twelve images 67x45, named so that plain sorting would put 10 before 9."""
    images = tmp_path / "images"
    images.mkdir()
    for number in range(12):
        write_png(images / f"{number}.png", 67, 45, shift=2 * number)
    return images


def packets_of(path: Path) -> list[tuple[float, bool]]:
    import av

    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name in ("libdav1d", "av1", "libaom-av1")
        return [
            (round(float(p.pts * p.time_base), 2), p.is_keyframe)
            for p in container.demux(stream)
            if p.size
        ]


def seconds_of(path: Path) -> list[float]:
    import av

    with av.open(str(path)) as container:
        return [float(p.pts * p.time_base) for p in container.demux(video=0) if p.size]


def retime(source: Path, out: Path, times: list[int]) -> Path:
    """Copy a video with other times, in ms."""
    import av

    with av.open(str(source)) as reader, av.open(str(out), "w") as writer:
        stream = reader.streams.video[0]
        copy = writer.add_stream_from_template(stream, opaque=True)
        packets = [packet for packet in reader.demux(stream) if packet.size]
        for packet, time in zip(packets, times, strict=True):
            packet.pts = packet.dts = time
            packet.time_base = Fraction(1, 1000)
            packet.stream = copy
            writer.mux(packet)
    return out


def write_h264(path: Path, num_frames: int, aspect: Fraction | None = None) -> Path:
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        for index in range(num_frames):
            pixels = np.full((48, 64, 3), 40 * index, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
        container.mux(stream.encode(None))
    return path


@pytest.mark.parametrize("suffix", [".ivf", ".mp4", ".mkv", ".webm"])
def test_a_folder_becomes_one_key_frame_and_then_inter_frames_in_any_container(
    folder: Path, tmp_path: Path, suffix: str
) -> None:
    options = EncodeOptions(check=False, frame_rate=10)
    result = encode_video(folder, tmp_path / f"clip{suffix}", options=options)

    packets = packets_of(result.path)
    assert [key for _, key in packets] == [True] + [False] * 11
    assert [time for time, _ in packets] == [round(n / 10, 2) for n in range(12)]
    assert (result.width, result.height, result.num_frames) == (67, 45, 12)
    assert result.image_names == tuple(f"{n}.png" for n in range(12))


def test_only_the_result_is_left_in_the_output_folder(folder: Path, tmp_path: Path) -> None:
    encode_video(folder, tmp_path / "new" / "clip.ivf", options=NO_CHECK)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["clip.ivf"]


def test_a_video_keeps_its_times_and_its_first_frames(folder: Path, tmp_path: Path) -> None:
    slow = EncodeOptions(check=False, frame_rate=4)
    encode_video(folder, tmp_path / "slow.mkv", options=slow)
    first = EncodeOptions(check=False, max_frames=5)
    result = encode_video(tmp_path / "slow.mkv", tmp_path / "first.mp4", options=first)

    assert [time for time, _ in packets_of(result.path)] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert result.image_names is None


def test_progress_counts_every_frame(folder: Path, tmp_path: Path) -> None:
    seen: list[tuple[int, int | None]] = []
    encode_video(
        folder,
        tmp_path / "clip.ivf",
        options=NO_CHECK,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen == [(n, 12) for n in range(1, 13)]


def test_images_of_different_sizes_are_named_and_nothing_is_written(
    folder: Path, tmp_path: Path
) -> None:
    write_png(folder / "7.png", 64, 45)
    with pytest.raises(DataError, match=r"0\.png is 67x45 but 7\.png is 64x45"):
        encode_video(folder, tmp_path / "out" / "clip.ivf", options=NO_CHECK)
    assert list((tmp_path / "out").iterdir()) == []


def test_one_image_has_no_motion(tmp_path: Path) -> None:
    write_png(tmp_path / "only.png", 64, 64)
    with pytest.raises(DataError, match=r"only one image \(only\.png\)"):
        open_frames(tmp_path, frame_rate=30, max_frames=None)


@pytest.mark.parametrize("num_frames", [1, 2])
def test_a_video_of_one_frame_has_no_motion_and_starts_no_encoder(
    folder: Path, tmp_path: Path, num_frames: int, capfd: pytest.CaptureFixture[str]
) -> None:
    clip = write_h264(tmp_path / "clip.mp4", num_frames)
    if num_frames == 2:
        assert encode_video(clip, tmp_path / "clip.ivf", options=NO_CHECK).num_frames == 2
        return
    with pytest.raises(DataError, match="only one frame"):
        encode_video(clip, tmp_path / "clip.ivf", options=NO_CHECK)
    assert capfd.readouterr().err == ""


def test_pixels_that_are_not_square_are_told(tmp_path: Path) -> None:
    clip = write_h264(tmp_path / "clip.mp4", 3, aspect=Fraction(4, 3))
    result = encode_video(clip, tmp_path / "clip.ivf", options=NO_CHECK)
    assert "1.33 times as wide as high" in result.warnings[0]
    square = write_h264(tmp_path / "clip.mp4", 3, aspect=Fraction(1))
    assert encode_video(square, tmp_path / "clip.ivf", options=NO_CHECK).warnings == ()


def test_times_of_a_variable_rate_stay_apart(folder: Path, tmp_path: Path) -> None:
    """Two frames within a millisecond, in a container that counts in frame durations."""
    steady = encode_video(folder, tmp_path / "steady.mkv", options=NO_CHECK)
    times = [0, 33, 34, 35, 500, 501, 502, 503, 504, 505, 506, 507]
    retimed = retime(steady.path, tmp_path / "phone.mkv", times)
    for suffix in (".ivf", ".mkv"):
        result = encode_video(retimed, tmp_path / f"clip{suffix}", options=NO_CHECK)
        assert seconds_of(result.path) == [time / 1000 for time in times]


def test_a_text_file_is_not_a_video(tmp_path: Path) -> None:
    for name in ("notes.txt", "notes.mp4", "notes"):
        (tmp_path / name).write_text("This is no video.\n" * 50)
        with pytest.raises(DataError, match="notes"):
            encode_video(tmp_path / name, tmp_path / "clip.ivf", options=NO_CHECK)


def test_an_empty_file_and_a_missing_one_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "empty.mp4").touch()
    with pytest.raises(DataError, match=r"empty\.mp4"):
        encode_video(tmp_path / "empty.mp4", tmp_path / "clip.ivf", options=NO_CHECK)
    with pytest.raises(FileNotFoundError, match=r"missing\.mp4"):
        encode_video(tmp_path / "missing.mp4", tmp_path / "clip.ivf", options=NO_CHECK)


def test_a_damaged_image_is_named(folder: Path, tmp_path: Path) -> None:
    (folder / "3.png").write_bytes(b"not a picture")
    with pytest.raises(DataError, match=r"3\.png"):
        encode_video(folder, tmp_path / "clip.ivf", options=NO_CHECK)


def test_an_unknown_container_is_refused_before_any_work(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"\.ivf, \.mkv, \.mp4, \.webm"):
        encode_video(folder, tmp_path / "clip.avi", options=NO_CHECK)


def test_an_unwritable_place_is_a_clear_error(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DataError, match="cannot write here"):
        encode_video(folder, tmp_path / "file" / "clip.ivf", options=NO_CHECK)
    (tmp_path / "clip.ivf").mkdir()
    with pytest.raises(DataError, match="is a folder"):
        encode_video(folder, tmp_path / "clip.ivf", options=NO_CHECK)


def test_every_known_encoder_is_listed_with_a_reason() -> None:
    statuses = {status.name: status for status in available_encoders()}
    assert list(statuses) == ["svt", "libaom", "nvenc", "qsv", "vaapi"]
    assert statuses["svt"].available
    assert all(status.reason for status in statuses.values())


def test_without_an_ffmpeg_executable_the_error_lists_what_works_and_the_pip_line(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mvmatch.encode.executable.ffmpeg_executables", list)
    options = EncodeOptions(encoder="libaom")
    with pytest.raises(UnsupportedError, match=r"mvmatch\[encoders\].*Available here: svt"):
        encode_video(folder, tmp_path / "clip.ivf", options=options)


@pytest.mark.parametrize("usage", ["realtime", "good"])
def test_libaom_writes_one_key_frame(folder: Path, tmp_path: Path, usage) -> None:
    pytest.importorskip("imageio_ffmpeg")
    options = EncodeOptions(encoder="libaom", usage=usage, check=False)
    result = encode_video(folder, tmp_path / "clip.ivf", options=options)
    assert f"-usage {usage}" in result.settings
    assert [key for _, key in packets_of(result.path)] == [True] + [False] * 11


@pytest.mark.parametrize("encoder", ["svt", "libaom"])
def test_grey_values_of_images_are_shown_as_they_are(encoder, tmp_path: Path) -> None:
    import av

    if encoder == "libaom":
        pytest.importorskip("imageio_ffmpeg")
    images = tmp_path / "images"
    images.mkdir()
    for index in range(3):
        frame = av.VideoFrame.from_ndarray(np.full((64, 64, 3), 40, np.uint8), format="rgb24")
        frame.save(str(images / f"{index}.png"))
    encode_video(images, tmp_path / "clip.ivf", options=EncodeOptions(encoder=encoder))
    with av.open(str(tmp_path / "clip.ivf")) as container:
        shown = next(container.decode(video=0)).to_ndarray(format="rgb24")
    assert abs(float(shown.mean()) - 40) < 2


def test_a_video_of_limited_range_stays_one(tmp_path: Path) -> None:
    """What says nothing of its range is shown as before: 16 is black."""
    import av

    pytest.importorskip("imageio_ffmpeg")
    with av.open(str(tmp_path / "clip.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        for _ in range(3):
            planes = np.full((96, 64), 128, np.uint8)
            planes[:64] = 16
            container.mux(stream.encode(av.VideoFrame.from_ndarray(planes, format="yuv420p")))
        container.mux(stream.encode(None))
    options = EncodeOptions(encoder="libaom")
    encode_video(tmp_path / "clip.mkv", tmp_path / "clip.ivf", options=options)
    with av.open(str(tmp_path / "clip.ivf")) as container:
        shown = next(container.decode(video=0)).to_ndarray(format="rgb24")
    assert shown.mean() < 2


def test_an_encoder_that_refuses_its_settings_says_why(folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    options = EncodeOptions(encoder="libaom", quality=999, check=False)
    with pytest.raises(UnsupportedError, match="crf"):
        encode_video(folder, tmp_path / "clip.ivf", options=options)
    assert not (tmp_path / "clip.ivf").exists()


def test_numbers_in_names_sort_by_value() -> None:
    names = ["img10.png", "img9.png", "IMG1.png", "img02.png"]
    assert sorted(names, key=natural_key) == ["IMG1.png", "img02.png", "img9.png", "img10.png"]


def test_the_checker_weighs_by_area_and_splits_compound_blocks() -> None:
    checker = EncodingChecker()
    compound = int(MotionFlags.COMPOUND)
    checker.push_motion(
        5,
        {
            "block": np.array([[0, 0, 16, 16], [16, 0, 16, 16], [16, 0, 16, 16]], np.int32),
            "ref_frame": np.array([4, 4, 3], np.int32),
            "flags": np.array([0, compound, compound], np.uint16),
        },
    )
    check = checker.result()
    assert check.distance_share == {1: 0.75, 2: 0.25}
    assert check.warnings() == (
        "only 75% of the vectors' area points to the previous frame (expected at least 90%)",
    )


def test_the_checker_warns_about_key_frames() -> None:
    cut = EncodingChecker(num_frames=20, key_frames=[0, 8])
    assert cut.result().warnings() == ("tracks are cut at the key frames 8",)
    still = EncodingChecker(num_frames=3, key_frames=[0, 1, 2])
    assert "every frame is a key frame" in still.result().warnings()[0]


def test_the_result_is_read_back_and_suits_matching(folder: Path, tmp_path: Path) -> None:
    result = encode_video(folder, tmp_path / "clip.mp4")
    assert result.check is not None
    assert result.check.num_frames == 12
    assert result.check.key_frames == (0,)
    assert result.check.previous_share > 0.9
    assert result.check.covered > 0.5
    assert result.warnings == ()


def test_a_result_the_parser_cannot_read_is_kept_with_a_warning(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mvmatch import _core
    from mvmatch.errors import BitstreamError

    def damaged() -> None:
        raise BitstreamError("symbol padding is not zero", section="8.2.4")

    monkeypatch.setattr(_core, "Av1Parser", damaged)
    result = encode_video(folder, tmp_path / "clip.ivf")
    assert result.path.exists()
    assert result.warnings == ("the result could not be checked: symbol padding is not zero",)


def test_the_result_says_with_which_settings_it_was_made(folder: Path, tmp_path: Path) -> None:
    options = EncodeOptions(check=False, quality=41, speed=11)
    result = encode_video(folder, tmp_path / "clip.ivf", options=options)
    assert "preset=11 crf=41" in result.settings
    assert "pred-struct=1:rtc=1:hierarchical-levels=0" in result.settings
    assert result.num_bytes < encode_video(folder, tmp_path / "fine.ivf").num_bytes


@pytest.mark.skipif(not THREADS.is_dir(), reason="the system does not list threads")
def test_no_thread_is_left_at_real_time_priority(folder: Path, tmp_path: Path) -> None:
    """SVT asks for it as the super-user; whatever this process starts later would inherit it."""
    policies: set[int] = set()

    def look(_done: int, _of: int | None) -> None:
        for thread in THREADS.iterdir():
            with contextlib.suppress(ProcessLookupError):  # it ended since it was listed
                policies.add(os.sched_getscheduler(int(thread.name)))

    encode_video(folder, tmp_path / "out.ivf", options=NO_CHECK, progress=look)
    assert policies == {os.SCHED_OTHER}
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
