"""What a motion field means: px of the output picture, display indices, times, layers, models."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("mvmatch._core", reason="the compiled module is not built")

from mvmatch.cli import main
from mvmatch.errors import DataError
from mvmatch.matching import match_video
from mvmatch.sources import ReadOptions, open_video
from mvmatch.sources.av1 import Av1Source
from mvmatch.types import MotionFlags

if TYPE_CHECKING:
    from mvmatch._core import CodedFrame
    from mvmatch.sources import FrameFacts
    from mvmatch.types import MotionField

CORPUS = Path(__file__).resolve().parents[2] / "tests" / "data" / "corpus"
STREAMS = sorted(path.stem for path in CORPUS.glob("*.ivf"))
IVF_HEADER, IVF_FRAME = 32, 12


def fields_of(path: Path, operating_point: int = 0) -> list[MotionField]:
    with open_video(path, operating_point=operating_point) as source:
        return list(source)


def facts_of(path: Path) -> list[FrameFacts]:
    with open_video(path) as source:
        for _ in source:
            pass
        return list(source.frames)


def coded_of(path: Path) -> list[CodedFrame]:
    with open_video(path) as source:
        assert isinstance(source, Av1Source)
        return [coded for coded, _ in source.coded_frames() if not coded.show_existing_frame]


def size_of(path: Path, operating_point: int = 0) -> tuple[int, int]:
    with open_video(path, operating_point=operating_point) as source:
        return source.info.width, source.info.height


@pytest.mark.parametrize("name", STREAMS)
def test_pictures_are_shown_in_order_without_gaps_or_duplicates(name: str) -> None:
    frames = facts_of(CORPUS / f"{name}.ivf")
    shown = [frame.display_index for frame in frames if frame.is_shown]
    assert shown == list(range(len(shown)))
    assert {frame.display_index for frame in frames} == set(shown)


@pytest.mark.parametrize("name", STREAMS)
def test_a_vector_refers_to_another_picture_that_was_decoded_before(name: str) -> None:
    known: set[int] = set()
    for field in fields_of(CORPUS / f"{name}.ivf"):
        references = set(field.ref_frame.tolist())
        assert field.frame not in references
        assert references <= known
        known.add(field.frame)


def raw_rows(coded: CodedFrame) -> tuple[np.ndarray, np.ndarray]:
    """Vectors [x, y] in 1/8 px and corners [x, y] in px of the coded frame, as rows of a field."""
    blocks = coded.blocks()
    name = blocks["ref_frame"].astype(int)
    display = np.r_[coded.display_index, np.asarray(coded.ref_display_index)]
    is_row = (name > 0) & (display[np.maximum(name, 0)] != coded.display_index)
    corner = 4 * np.stack([blocks["mi_col"], blocks["mi_row"]], axis=1)
    mv = blocks["mv"].reshape(-1, 2, 2)[:, :, ::-1]
    return mv[is_row], np.repeat(corner[:, None], 2, axis=1)[is_row]


@pytest.mark.parametrize("name", ["aom_resize_fix", "aom_resize_rand", "svc_L2T1"])
def test_every_frame_is_in_pixels_of_one_picture_whatever_its_own_size(name: str) -> None:
    path = CORPUS / f"{name}.ivf"
    size = size_of(path)
    sizes: set[tuple[int, int]] = set()
    for field, coded in zip(fields_of(path), coded_of(path), strict=True):
        assert (field.width, field.height) == size
        sizes.add((coded.upscaled_width, coded.height))
        scale = np.array(size) / (coded.upscaled_width, coded.height)
        mv, corner = raw_rows(coded)
        np.testing.assert_allclose(field.mv, mv / 8 * scale, rtol=1e-6)
        np.testing.assert_allclose(field.block[:, :2], corner * scale, atol=0.5)
    assert len(sizes) > 1


@pytest.mark.parametrize("name", ["aom_superres_fix", "aom_superres_rand", "svt14_p12_sr"])
def test_superres_vectors_are_in_pixels_of_the_upscaled_picture(name: str) -> None:
    narrow = 0
    for coded in coded_of(CORPUS / f"{name}.ivf"):
        scale = np.array([coded.upscaled_width / coded.width, 1])
        narrow += scale[0] > 1
        (mv, corner), rows = raw_rows(coded), coded.motion()
        np.testing.assert_allclose(rows["mv"], mv / 8 * scale, rtol=1e-6)
        np.testing.assert_allclose(rows["block"][:, :2], corner * scale, atol=0.5)
    assert narrow > 0


def test_the_layers_of_a_picture_tell_the_same_motion() -> None:
    fields = fields_of(CORPUS / "svc_L2T1.ivf")
    ratios: list[float] = []
    for below, above in zip(fields[2::2], fields[3::2], strict=True):
        assert below.frame == above.frame
        assert (below.is_shown, above.is_shown) == (False, True)
        lengths = [float(np.abs(field.mv).mean()) for field in (below, above)]
        ratios.append(lengths[0] / lengths[1])
    # In px of their own pictures the lower layer's vectors would be half as long.
    assert 0.75 < np.median(ratios) < 1.33


def test_an_operating_point_leaves_out_layers_and_their_size() -> None:
    path = CORPUS / "svc_L2T1.ivf"
    assert size_of(path) == (320, 240)
    assert size_of(path, 1) == (160, 120)
    fields = fields_of(path, 1)
    assert [field.frame for field in fields] == list(range(10))
    assert all(field.is_shown and field.width == 160 for field in fields)
    below = fields_of(path)[::2]
    for ours, theirs in zip(fields, below, strict=True):
        np.testing.assert_allclose(ours.mv * 2, theirs.mv)


@pytest.mark.parametrize("chosen", [2, -1])
def test_an_operating_point_that_is_not_there_is_named(chosen: int) -> None:
    with pytest.raises(DataError, match="operating point"):
        open_video(CORPUS / "svc_L2T1.ivf", operating_point=chosen)


def test_the_command_line_takes_an_operating_point(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "motion.parquet"
    clip = str(CORPUS / "svc_L1T3.ivf")
    assert main(["extract", clip, str(table), "--operating-point", "2"]) == 0
    assert "in 4 frames" in capsys.readouterr().out
    assert main(["probe", clip, "--operating-point", "3"]) == 1
    assert "Choose one from 0 to 2." in capsys.readouterr().err
    assert main(["extract", clip, str(table), "--set", "read.operating_point=2"]) == 0
    assert "in 4 frames" in capsys.readouterr().out


def test_matching_takes_an_operating_point_after_damage_too() -> None:
    read = ReadOptions(errors="resume", operating_point=1)
    match = match_video(CORPUS / "svc_L2T1.ivf", read=read)
    assert (match.info.width, match.num_frames, match.skipped) == (160, 10, ())
    # What the caller asked for cannot be had: no damage to skip.
    absent = ReadOptions(errors="resume", operating_point=2)
    with pytest.raises(DataError, match="operating point"):
        match_video(CORPUS / "svc_L2T1.ivf", read=absent)


@pytest.mark.parametrize(
    "name", ["aom_screen_ai", "aom_screen_good", "aom_mix_screen10", "aomx_intmv"]
)
def test_copies_inside_a_picture_are_not_motion(name: str) -> None:
    copies = 0
    for coded in coded_of(CORPUS / f"{name}.ivf"):
        blocks, motion = coded.blocks(), coded.motion()
        copied = blocks["use_intrabc"].astype(bool)
        copies += int(np.any(blocks["mv"][copied] != 0, axis=1).sum())
        if copied.any():
            assert len(motion["mv"]) == 0
    assert copies > 0


@pytest.mark.parametrize(
    ("name", "flag"),
    [
        ("aomx_affine", MotionFlags.GLOBAL),
        ("aom_good1_gm", MotionFlags.GLOBAL),
        ("aom_good1_gm", MotionFlags.WARPED),
        ("svt14_p2_ra", MotionFlags.WARPED),
    ],
)
def test_a_model_gives_the_vector_at_the_middle_of_its_block(name: str, flag: MotionFlags) -> None:
    errors: list[np.ndarray] = []
    for field in fields_of(CORPUS / f"{name}.ivf"):
        rows = ~np.isnan(field.warp[:, 0]) & ((field.flags & flag) != 0)
        # A block's vector belongs to the sample up and left of its middle.
        xy = field.centers[rows] - 0.5
        model = field.warp[rows].reshape(-1, 2, 3)
        there = (model[:, :, :2] @ xy[:, :, None])[:, :, 0] + model[:, :, 2]
        errors.append(np.abs(there - xy - field.mv[rows]).max(axis=1))
    error = np.concatenate(errors)
    assert len(error) > 0
    assert error.max() < 0.26


def packets_of(path: Path) -> list[bytes]:
    data, position = path.read_bytes(), IVF_HEADER
    packets: list[bytes] = []
    while position < len(data):
        size = int.from_bytes(data[position : position + 4], "little")
        packets.append(data[position + IVF_FRAME : position + IVF_FRAME + size])
        position += IVF_FRAME + size
    return packets


def test_another_sequence_with_another_size_may_follow(tmp_path: Path) -> None:
    parts = [CORPUS / f"{name}.ivf" for name in ("aom_64x48", "aom_mono10", "aom_34x18")]
    joined = tmp_path / "joined.ivf"
    packets = [packet for part in parts for packet in packets_of(part)]
    units = [
        len(packet).to_bytes(4, "little") + number.to_bytes(8, "little") + packet
        for number, packet in enumerate(packets)
    ]
    joined.write_bytes(parts[0].read_bytes()[:IVF_HEADER] + b"".join(units))
    found = coded_of(joined)
    expected = [coded for part in parts for coded in coded_of(part)]
    for ours, theirs in itertools.zip_longest(found, expected):
        blocks = theirs.blocks()
        assert all(np.array_equal(ours.blocks()[name], blocks[name]) for name in blocks)
    shown = [frame.display_index for frame in facts_of(joined) if frame.is_shown]
    assert shown == list(range(len(shown)))


@pytest.mark.parametrize("suffix", ["mp4", "frag.mp4", "mkv", "webm"])
def test_every_shown_picture_has_the_time_of_its_container(suffix: str) -> None:
    frames = facts_of(CORPUS / "containers" / f"aom_good1_gm.{suffix}")
    assert all((frame.pts is not None) == frame.is_shown for frame in frames)
    times = [frame.pts for frame in frames if frame.pts is not None]
    expected = [frame.pts for frame in facts_of(CORPUS / "aom_good1_gm.ivf") if frame.is_shown]
    np.testing.assert_allclose(np.diff(times), np.diff(expected), atol=0.0011)
    assert all(later > earlier for earlier, later in itertools.pairwise(times))
