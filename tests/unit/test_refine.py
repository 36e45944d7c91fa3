"""Alignment of tracks to pictures."""

from __future__ import annotations

import dataclasses
import sys
import weakref
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from mvmatch.cli import main
from mvmatch.errors import DataError, MissingExtraError
from mvmatch.matching import match_video
from mvmatch.pictures import refine_match
from mvmatch.refine import RefineOptions, gray_pictures, refine_groups, refine_tracks
from mvmatch.sources import Skipped
from mvmatch.store import read_tracks
from mvmatch.testing import exact_paths, synthetic_drive
from mvmatch.tracks import TrackOptions
from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

cv2 = pytest.importorskip("cv2")

KEEP = RefineOptions(unaligned="keep")


def tracks_along(paths: NDArray[np.float64]) -> Tracks:
    """Tracks of (F, N, 2) positions, each up to where it is NaN for the first time."""
    rows = []
    for path in paths.transpose(1, 0, 2):
        gone = np.isnan(path).any(axis=1)
        end = int(gone.argmax()) if gone.any() else len(path)
        if end > 1:
            rows.append([(frame, *path[frame]) for frame in range(end)])
    return Tracks.from_lists(*rows)


def perturbed(tracks: Tracks, deviation: float) -> Tracks:
    """Noise on every observation but the first of each track: that one says what is followed."""
    noise = np.random.default_rng(0).normal(0, deviation, tracks.xy.shape)
    noise[tracks.offsets[:-1]] = 0
    return dataclasses.replace(tracks, xy=(tracks.xy + noise).astype(np.float32))


def grid(width: int, height: int, step: int, margin: int) -> NDArray[np.float64]:
    x, y = np.meshgrid(
        np.arange(margin, width - margin, step), np.arange(margin, height - margin, step)
    )
    return np.column_stack([x.ravel(), y.ravel()]) + 0.5


@pytest.fixture(scope="module")
def spiral() -> tuple[list[NDArray[np.uint8]], NDArray[np.float64]]:
    """A texture that turns by 2 degrees and grows by 2 % per frame, and (F, N, 2) true paths."""
    texture = np.random.default_rng(1).uniform(0, 255, (240, 320))
    texture = cv2.GaussianBlur(texture, (0, 0), 1.5)
    texture = ((texture - texture.mean()) * 5 + 128).clip(0, 255).astype(np.uint8)
    points = grid(320, 240, 12, 80)
    pictures, paths = [], []
    for frame in range(12):
        # OpenCV has the centre of the first pixel at (0, 0).
        matrix = cv2.getRotationMatrix2D((160, 120), 2.0 * frame, 1.02**frame)
        pictures.append(cv2.warpAffine(texture, matrix, (320, 240), flags=cv2.INTER_CUBIC))
        paths.append((points - 0.5) @ matrix[:, :2].T + matrix[:, 2] + 0.5)
    return pictures, np.array(paths)


def test_refined_tracks_are_nearer_to_the_truth_than_perturbed_ones() -> None:
    scene = synthetic_drive(6, (320, 180))
    pictures = [np.ascontiguousarray(scene.render(frame)[:, :, 1]) for frame in range(6)]
    truth = tracks_along(exact_paths(scene, 0, grid(320, 180, 8, 8)))
    given = perturbed(truth, 0.6)
    before = np.linalg.norm(given.xy - truth.xy, axis=1)

    kept = refine_tracks(given, pictures, options=KEEP)
    after = np.linalg.norm(kept.xy - truth.xy, axis=1)
    later = truth.frame > 0
    assert np.median(after[later]) < 0.3 * np.median(before[later])

    ended = refine_tracks(given, pictures)
    assert 0.4 * truth.num_observations < ended.num_observations < truth.num_observations


def test_a_patch_is_followed_while_it_turns_and_grows(
    spiral: tuple[list[NDArray[np.uint8]], NDArray[np.float64]],
) -> None:
    pictures, paths = spiral
    truth = tracks_along(paths)
    refined = refine_tracks(perturbed(truth, 0.4), pictures, options=KEEP)
    error = np.linalg.norm(refined.xy - truth.xy, axis=1)[truth.frame == 11]
    assert np.median(error) < 0.15


def test_each_anchor_hands_its_point_to_the_next(
    spiral: tuple[list[NDArray[np.uint8]], NDArray[np.float64]],
) -> None:
    pictures, paths = spiral
    truth = tracks_along(paths)
    options = RefineOptions(unaligned="keep", anchor_age=3)
    refined = refine_tracks(perturbed(truth, 0.4), pictures, options=options)
    error = np.linalg.norm(refined.xy - truth.xy, axis=1)[truth.frame == 11]
    assert np.median(error) < 0.15


def test_any_number_of_points_is_aligned(
    spiral: tuple[list[NDArray[np.uint8]], NDArray[np.float64]],
) -> None:
    """OpenCV itself takes fewer than 32,767 of them at once."""
    x, y = np.meshgrid(np.linspace(80, 240, 260), np.linspace(60, 180, 130))
    still = np.column_stack([x.ravel(), y.ravel()])
    truth = tracks_along(np.array([still, still]))
    assert len(truth) > 32_767
    picture = spiral[0][0]
    refined = refine_tracks(perturbed(truth, 0.4), [picture, picture], options=KEEP)
    error = np.linalg.norm(refined.xy - truth.xy, axis=1)[truth.frame == 1]
    assert np.quantile(error, 0.9) < 0.1


def test_light_that_changes_is_not_taken_for_motion(
    spiral: tuple[list[NDArray[np.uint8]], NDArray[np.float64]],
) -> None:
    pictures, paths = spiral
    darker = [
        (picture * 0.5 + 50 - 4 * frame).astype(np.uint8) for frame, picture in enumerate(pictures)
    ]
    truth = tracks_along(paths)
    refined = refine_tracks(perturbed(truth, 0.4), darker, options=KEEP)
    error = np.linalg.norm(refined.xy - truth.xy, axis=1)[truth.frame == 9]
    assert np.median(error) < 0.15


def test_a_point_on_a_flat_area_stays_as_it_was_or_ends() -> None:
    pictures = [np.full((64, 64), 90, np.uint8) for _ in range(4)]
    tracks = Tracks.from_lists([(f, 20.5 + 1.25 * f, 30.5) for f in range(4)])
    kept = refine_tracks(tracks, pictures, options=KEEP)
    np.testing.assert_array_equal(kept.xy, tracks.xy)
    np.testing.assert_array_equal(kept.frame, tracks.frame)
    assert len(refine_tracks(tracks, pictures)) == 0


def test_an_observation_that_would_move_too_far_ends_its_track_or_is_kept(
    spiral: tuple[list[NDArray[np.uint8]], NDArray[np.float64]],
) -> None:
    pictures, paths = spiral
    wrong = paths[:6, 30:80].copy()
    wrong[3:, 7] += (6.0, 0.0)
    tracks = tracks_along(wrong)
    assert refine_tracks(tracks, pictures).lengths[7] == 3
    kept = refine_tracks(tracks, pictures, options=KEEP)
    moved = kept.xy[kept.offsets[7] :][3] - wrong[3, 7]
    assert np.linalg.norm(moved) < 0.5


def test_tracks_that_start_later_or_skip_frames_are_aligned_too(
    spiral: tuple[list[NDArray[np.uint8]], NDArray[np.float64]],
) -> None:
    pictures, paths = spiral
    frames = ((0, 1, 2, 3, 4, 5), (2, 3, 4, 5), (0, 1, 2, 4, 5))
    rows = [[(frame, *paths[frame, point]) for frame in frames[point % 3]] for point in range(90)]
    truth = Tracks.from_lists(*rows)
    refined = refine_tracks(perturbed(truth, 0.4), pictures, options=KEEP)
    np.testing.assert_array_equal(refined.frame, truth.frame)
    error = np.linalg.norm(refined.xy - truth.xy, axis=1)
    for kind in range(3):
        assert np.median(error[(truth.track_index % 3 == kind) & (truth.frame == 5)]) < 0.15


def test_pictures_are_read_once_in_order_and_let_go(
    spiral: tuple[list[NDArray[np.uint8]], NDArray[np.float64]],
) -> None:
    pictures, paths = spiral
    given: list[weakref.ref[NDArray[np.uint8]]] = []
    most = 0

    def stream() -> Iterator[NDArray[np.uint8]]:
        nonlocal most
        for number in range(len(pictures)):
            most = max(most, sum(each() is not None for each in given))
            picture = pictures[number].copy()
            given.append(weakref.ref(picture))
            yield picture
            del picture

    refine_tracks(tracks_along(paths), stream())
    assert len(given) == len(pictures)
    assert most <= 1


def test_without_pictures_nothing_is_aligned() -> None:
    tracks = Tracks.from_lists([(0, 5.0, 5.0), (1, 6.0, 5.0)])
    assert len(refine_tracks(tracks, [])) == 0
    np.testing.assert_array_equal(refine_tracks(tracks, [], options=KEEP).xy, tracks.xy)


def test_a_coloured_picture_is_refused() -> None:
    tracks = Tracks.from_lists([(0, 5.0, 5.0), (1, 6.0, 5.0)])
    with pytest.raises(ValueError, match=r"\(H, W\) uint8, not \(8, 8, 3\) uint8"):
        refine_tracks(tracks, [np.zeros((8, 8, 3), np.uint8)])


def test_without_opencv_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    tracks = Tracks.from_lists([(0, 5.0, 5.0), (1, 6.0, 5.0)])
    with pytest.raises(MissingExtraError, match=r"pip install 'mvmatch\[refine\]'"):
        refine_tracks(tracks, [])


@pytest.mark.parametrize(
    "values",
    [{"window": 10}, {"window": 1}, {"anchor_age": 0}, {"max_move": -1.0}, {"unaligned": "drop"}],
)
def test_settings_that_mean_nothing_are_refused(values: dict[str, int]) -> None:
    with pytest.raises(ValueError, match=next(iter(values))):
        RefineOptions(**values)


@pytest.mark.parametrize("name", ["svt_random_access_p6.ivf", "svt_flat_p8.mkv", "svt_10bit.ivf"])
def test_an_av1_video_shows_as_many_pictures_as_its_tracks_count(name: str, data: Path) -> None:
    match = match_video(data / name)
    pictures = list(gray_pictures(data / name))
    assert len(pictures) == match.num_frames
    assert {picture.shape for picture in pictures} == {(match.info.height, match.info.width)}
    assert pictures[0].std() > 5


def test_images_are_read_in_natural_order(tmp_path: Path) -> None:
    for number in (1, 2, 10):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((16, 16), 20 * number, np.uint8))
    means = [float(picture.mean()) for picture in gray_pictures(tmp_path)]
    assert len(means) == 3
    assert all(a < b for a, b in pairwise(means))


def drift(tracks: Tracks) -> float:
    """Median error after ten frames of drive.ivf, px."""
    scene = synthetic_drive(20, (352, 200))  # what drive.ivf shows
    errors = []
    for frame in range(10):
        pair = tracks.between(frame, frame + 10)
        target, visible = scene.transfer(frame, frame + 10, pair.xy0)
        errors.append(np.linalg.norm(pair.xy1 - target, axis=1)[visible])
    return float(np.median(np.concatenate(errors)))


def test_refined_tracks_have_drifted_less_over_ten_frames(data: Path) -> None:
    match = match_video(data / "drive.ivf")
    assert drift(refine_match(match, data / "drive.ivf").tracks) < 0.85 * drift(match.tracks)


def test_groups_are_aligned_as_if_each_were_alone(
    spiral: tuple[list[NDArray[np.uint8]], NDArray[np.float64]],
) -> None:
    pictures, paths = spiral
    groups = [perturbed(tracks_along(paths[:end, part]), 0.4)
              for end, part in ((8, slice(None, None, 2)), (12, slice(1, None, 2)))]  # fmt: skip
    together = refine_groups([*groups, Tracks.from_lists()], pictures)
    assert len(together[2]) == 0
    for refined, group in zip(together, groups, strict=False):
        alone = refine_tracks(group, pictures)
        np.testing.assert_array_equal(refined.xy, alone.xy)
        np.testing.assert_array_equal(refined.frame, alone.frame)


def test_tracks_that_make_a_model_denser_are_aligned_too_and_change_nothing_else(
    data: Path,
) -> None:
    match = match_video(data / "drive.ivf", options=TrackOptions.preset("dense"))
    refined = refine_match(match, data / "drive.ivf")
    without = refine_match(match, data / "drive.ivf", groups=["tracks"])
    np.testing.assert_array_equal(without.tracks.xy, refined.tracks.xy)
    np.testing.assert_array_equal(without.further.xy, match.further.xy)
    assert drift(refined.further) < 0.85 * drift(match.further)


def test_pictures_of_something_else_are_refused(data: Path) -> None:
    match = match_video(data / "drive.ivf")
    with pytest.raises(DataError, match="352x200"):
        refine_match(match, data / "svt_flat_p8.ivf")


def test_tracks_of_a_stream_with_holes_are_not_refined(data: Path) -> None:
    match = match_video(data / "drive.ivf")
    hole = Skipped(after_frame=1, num_errors=1, byte_offset=None, section=None, reason="cut")
    with pytest.raises(DataError, match="cannot be refined"):
        refine_match(dataclasses.replace(match, skipped=(hole,)), data / "drive.ivf")


def test_the_verb_track_refines_when_asked_to(data: Path, tmp_path: Path) -> None:
    plain, refined = tmp_path / "plain.parquet", tmp_path / "refined.parquet"
    assert main(["track", str(data / "drive.ivf"), str(plain)]) == 0
    assert main(["track", str(data / "drive.ivf"), str(refined), "--refine"]) == 0
    before, after = (read_tracks(path).tracks for path in (plain, refined))
    assert 0.3 * before.num_observations < after.num_observations < before.num_observations


def test_a_motion_table_cannot_be_refined(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "motion.parquet"
    assert main(["extract", str(data / "drive.ivf"), str(table)]) == 0
    assert main(["track", str(table), str(tmp_path / "out.parquet"), "--refine"]) == 1
    assert "holds no pictures" in capsys.readouterr().err


def test_the_flag_and_the_option_are_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--print-config", "--refine"]) == 0
    flag = capsys.readouterr().out
    assert main(["run", "--print-config", "--set", "refine.when=always"]) == 0
    assert '[refine]\nwhen = "always"\n' in flag
    assert capsys.readouterr().out == flag
