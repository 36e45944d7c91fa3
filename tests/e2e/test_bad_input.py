"""What users hand over by mistake: one clear message, an exit code, nothing that looks complete."""

from __future__ import annotations

import json
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvmatch.cli import main
from mvmatch.config import RunOptions
from mvmatch.footage import Footage
from mvmatch.matching import match_video
from mvmatch.pipeline import reconstruct_video
from mvmatch.store import read_tracks

if TYPE_CHECKING:
    from pathlib import Path

    from _pytest.capture import CaptureFixture


def refused(words: list[str], capsys: CaptureFixture[str]) -> str:
    """Run a command line that must fail on its data; return its one message."""
    assert main(words) == 1
    error = capsys.readouterr().err
    assert "Traceback" not in error
    message = error[error.index("error: ") :]  # a slow machine shows progress before it
    assert len(message.splitlines()) == 2
    return message


def write_images(folder: Path, sizes: list[tuple[int, int]]) -> Path:
    from matplotlib.image import imsave

    folder.mkdir()
    for index, (width, height) in enumerate(sizes):
        pixels = np.random.default_rng(index).integers(0, 255, (height, width, 3), np.uint8)
        imsave(folder / f"{index:04d}.png", pixels)
    return folder


def write_mpeg4(path: Path, num_frames: int = 5) -> Path:
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=Fraction(10))
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for index in range(num_frames):
            pixels = np.full((48, 64, 3), 40 * index, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(pixels, format="rgb24")))
        container.mux(stream.encode())
    return path


def test_another_codec_is_named_and_the_way_out_is_shown(
    tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    clip = write_mpeg4(tmp_path / "clip.mp4")
    error = refused(["track", str(clip), str(tmp_path / "tracks.parquet")], capsys)
    assert "mpeg4" in error
    assert "mvmatch encode" in error
    assert not (tmp_path / "tracks.parquet").exists()


def test_images_of_two_sizes_are_refused_by_name(
    tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    folder = write_images(tmp_path / "frames", [(64, 48), (64, 48), (64, 32)])
    error = refused(["run", str(folder), "-o", str(tmp_path / "out")], capsys)
    assert "0002.png" in error
    assert not (tmp_path / "out").exists()


def test_one_image_is_refused(tmp_path: Path, capsys: CaptureFixture[str]) -> None:
    folder = write_images(tmp_path / "frames", [(64, 48)])
    refused(["run", str(folder), "-o", str(tmp_path / "out")], capsys)
    assert not (tmp_path / "out").exists()


def test_a_video_of_key_frames_is_sent_to_the_encoder(
    data: Path, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    words = ["run", str(data / "svt_all_key.ivf"), "-o", str(tmp_path / "out")]
    error = refused(words, capsys)
    assert "key frame" in error
    assert "--re-encode" in error
    assert not (tmp_path / "out").exists()


def test_a_key_frame_every_two_frames_is_sent_to_the_encoder(
    data: Path, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    words = ["run", str(data / "svt_key_every_2.ivf"), "-o", str(tmp_path / "out")]
    error = refused(words, capsys)
    assert "no track of 3 frames" in error
    assert "--re-encode" in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("verb", ["run", "track", "extract", "encode"])
def test_a_place_that_cannot_be_written_is_named(
    verb: str, data: Path, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    out = tmp_path / "file" / "out.ivf"
    words = [verb, str(data / "svt_flat_p8.ivf"), *(["-o"] if verb == "run" else []), str(out)]
    assert str(tmp_path / "file") in refused(words, capsys)


def test_files_of_others_are_not_replaced(
    data: Path, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    (tmp_path / "database.db").write_text("precious")
    refused(["run", str(data / "svt_flat_p8.ivf"), "-o", str(tmp_path)], capsys)
    assert (tmp_path / "database.db").read_text() == "precious"
    assert [entry.name for entry in tmp_path.iterdir()] == ["database.db"]


def test_frames_before_the_damage_are_kept_and_counted(
    data: Path, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    whole = (data / "svt_flat_p8.ivf").read_bytes()
    clip, table = tmp_path / "clip.ivf", tmp_path / "tracks.parquet"
    clip.write_bytes(whole[: int(len(whole) * 0.6)])
    assert main(["track", str(clip), str(table), "--json"]) == 1
    printed = json.loads(capsys.readouterr().out)
    num_frames = read_tracks(table).info.num_frames
    assert num_frames is not None
    assert 2 <= num_frames < match_video(data / "svt_flat_p8.ivf").num_frames
    assert printed["num_frames"] == num_frames
    assert printed["error"]["kind"] == "BitstreamError"
    assert "before the damage" in printed["partial"]


def test_a_damaged_stream_still_gives_a_run_that_says_so(data: Path, tmp_path: Path) -> None:
    whole = (data / "drive.ivf").read_bytes()
    clip, out = tmp_path / "clip.ivf", tmp_path / "out"
    clip.write_bytes(whole[: int(len(whole) * 0.7)])
    camera = "PINHOLE,260.48,260.48,176,100"
    assert main(["run", str(clip), "-o", str(out), "--camera", camera]) == 1
    report = json.loads((out / "report.json").read_text())
    assert report["damage"]["frames_read"] == report["input"]["num_frames"]
    assert report["damage"]["message"]


def test_a_cut_mp4_is_refused(data: Path, tmp_path: Path, capsys: CaptureFixture[str]) -> None:
    clip = tmp_path / "clip.mp4"
    whole = (data / "svt_flat_p8.mp4").read_bytes()
    clip.write_bytes(whole[: len(whole) // 2])
    assert str(clip) in refused(["track", str(clip), str(tmp_path / "tracks.parquet")], capsys)


def test_a_cut_in_the_container_header_is_refused(
    data: Path, tmp_path: Path, capsys: CaptureFixture[str]
) -> None:
    clip = tmp_path / "clip.ivf"
    clip.write_bytes((data / "svt_flat_p8.ivf").read_bytes()[:20])
    assert str(clip) in refused(["probe", str(clip)], capsys)


def test_things_that_move_before_a_camera_at_rest_make_no_model(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Preset paper leaves out zero vectors: of such footage it has the movers alone."""
    monkeypatch.setattr(Footage, "stands_still", True)
    for preset, is_refused in (("paper", True), ("default", False)):
        made = reconstruct_video(
            data / "drive.ivf",
            tmp_path / preset,
            camera="260.48",
            options=RunOptions.preset(preset),
        )
        assert made.model.accepted is not is_refused
        assert is_refused == any("does not move" in reason for reason in made.model.reasons)
    assert not (tmp_path / "paper" / "sparse").exists()
