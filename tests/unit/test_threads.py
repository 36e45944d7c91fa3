"""Any number of threads of the parser gives the same fields, times and errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mvmatch.errors import BitstreamError
from mvmatch.sources import open_video

CORPUS = Path(__file__).parent.parent / "data" / "corpus"


def fields(path, threads, errors="raise"):
    with open_video(path, threads=threads, errors=errors) as video:
        found = [(field.frame, field.pts, field.mv, field.ref_frame) for field in video]
        return found, [str(part) for part in video.skipped]


def assert_same(path, errors="raise"):
    alone, skipped = fields(path, 1, errors)
    for threads in (2, 4):
        together, left_out = fields(path, threads, errors)
        assert left_out == skipped
        assert [item[:2] for item in together] == [item[:2] for item in alone]
        for (*_, mv, ref_frame), (*_, other_mv, other_ref) in zip(alone, together, strict=True):
            np.testing.assert_array_equal(mv, other_mv)
            np.testing.assert_array_equal(ref_frame, other_ref)
    return alone, skipped


@pytest.mark.parametrize("name", ["svt14_p2_ra.ivf", "aom_tiles_tg2.ivf", "aom_good4_cut.ivf"])
def test_fields_and_times_do_not_depend_on_the_number_of_threads(name):
    alone, _ = assert_same(CORPUS / name)
    times = [pts for _, pts, *_ in alone if pts is not None]
    assert len(set(times)) == len(times) > 5


def test_frames_before_damage_come_before_its_error(tmp_path):
    data = (CORPUS / "aom_good3_lag0.ivf").read_bytes()
    path = tmp_path / "cut.ivf"
    path.write_bytes(data[: len(data) * 2 // 3])
    read = {1: [], 3: []}
    for threads, frames in read.items():
        with open_video(path, threads=threads) as video, pytest.raises(BitstreamError):
            frames.extend(field.frame for field in video)
    assert read[1] == read[3]
    assert len(read[1]) > 3


def test_what_is_skipped_does_not_depend_on_the_number_of_threads(tmp_path):
    data = bytearray((CORPUS / "aom_rt10_er.ivf").read_bytes())
    data[len(data) // 3] ^= 0x55
    path = tmp_path / "damaged.ivf"
    path.write_bytes(data)
    _, skipped = assert_same(path, errors="resume")
    assert skipped


def test_a_negative_number_of_threads_is_refused():
    with pytest.raises(ValueError, match="-1 threads"):
        open_video(CORPUS / "aom_rt5.ivf", threads=-1)
