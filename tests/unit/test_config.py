"""Options to TOML and back, and what is refused on the way."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from mvmatch.config import RunOptions, from_mapping, load_options, to_toml
from mvmatch.errors import DataError
from mvmatch.tracks import TrackOptions

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("preset", ["default", "dense", "fast", "paper"])
def test_options_survive_the_way_through_toml(tmp_path: Path, preset: str) -> None:
    options = RunOptions(track=TrackOptions.preset(preset))
    path = tmp_path / "run.toml"
    path.write_text(to_toml(options))
    assert load_options(path) == options


def test_off_is_none_where_an_option_can_be_off() -> None:
    options = from_mapping({"track": {"max_drift": "off"}}, RunOptions())
    assert options.track.max_drift is None


def test_off_is_refused_where_an_option_cannot_be_off() -> None:
    with pytest.raises(DataError, match=r"track\.min_length must be a whole number, not 'off'"):
        from_mapping({"track": {"min_length": "off"}}, RunOptions())


def test_an_unknown_option_is_refused_with_the_known_ones() -> None:
    with pytest.raises(DataError, match=r"unknown option track\.max_gaps; there are: .*max_gap"):
        from_mapping({"track": {"max_gaps": 3}}, RunOptions())


def test_a_whole_number_is_a_number_but_true_is_not() -> None:
    assert from_mapping({"track": {"tau": 2}}, RunOptions()).track.tau == 2.0
    with pytest.raises(DataError, match="must be a number"):
        from_mapping({"track": {"tau": True}}, RunOptions())


def test_a_stage_is_a_table() -> None:
    with pytest.raises(DataError, match="track is a table"):
        from_mapping({"track": 3}, RunOptions())


def test_a_broken_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "run.toml"
    path.write_text("[track\n")
    with pytest.raises(DataError, match=r"run\.toml is not valid TOML"):
        load_options(path)


def test_values_outside_a_list_of_choices_are_refused() -> None:
    with pytest.raises(DataError, match="'translate' or 'fuse'"):
        from_mapping({"track": {"carry": "teleport"}}, RunOptions())
