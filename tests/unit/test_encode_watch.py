"""Work that is watched, and an encoder that stops working."""

from __future__ import annotations

import gc
import threading
import weakref
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest

from mvmatch.encode import EncodeOptions, encode_video, svt
from mvmatch.encode.watch import StalledError, watched
from mvmatch.errors import MvmatchError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@pytest.fixture
def release() -> Iterator[threading.Event]:
    """Lets go of work that hangs."""
    event = threading.Event()
    yield event
    event.set()


def test_work_has_its_result_and_tells_on_the_thread_that_waits() -> None:
    told: list[tuple[int, int | None, bool]] = []
    here = threading.current_thread()

    def work(tell: Any) -> str:
        assert threading.current_thread() is not here
        tell(1, None)
        tell(2, 2)
        return "done"

    def progress(done: int, total: int | None) -> None:
        told.append((done, total, threading.current_thread() is here))

    assert watched(work, progress, patience=60.0) == "done"
    assert told == [(1, None, True), (2, 2, True)]


def test_errors_of_the_work_are_those_of_the_caller() -> None:
    def work(_: Any) -> None:
        raise FileNotFoundError("no such picture")

    with pytest.raises(FileNotFoundError, match="no such picture"):
        watched(work, None, patience=60.0)


def test_what_failed_work_held_is_let_go_at_once() -> None:
    """Else an encoder ends whenever the garbage is collected, and says so."""

    class Encoder:
        pass

    held: list[weakref.ref[Encoder]] = []

    def work(_: Any) -> None:
        encoder = Encoder()
        held.append(weakref.ref(encoder))
        raise ValueError

    gc.disable()
    try:
        with suppress(ValueError):
            watched(work, None, patience=60.0)
        assert held[0]() is None
    finally:
        gc.enable()


def test_work_that_goes_on_is_waited_for_however_long(release: threading.Event) -> None:
    def work(tell: Any) -> int:
        for done in range(6):
            release.wait(0.4)
            tell(done, None)
        return 6

    assert watched(work, None, patience=1.5) == 6


def test_work_that_stops_is_given_up_and_ends_when_it_comes_back(release: threading.Event) -> None:
    ended = threading.Event()

    def work(tell: Any) -> None:
        tell(1, None)
        release.wait()
        try:
            tell(2, None)
        finally:
            ended.set()

    told: list[int] = []
    with pytest.raises(StalledError):
        watched(work, lambda done, _: told.append(done), patience=0.1)
    release.set()
    assert ended.wait(10.0)
    assert told == [1]


def test_an_interruption_ends_the_work() -> None:
    frames: list[int] = []

    def work(tell: Any) -> None:
        for frame in range(1_000_000):
            frames.append(frame)
            tell(frame, None)

    def interrupt(done: int, _: int | None) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        watched(work, interrupt, patience=60.0)
    assert len(frames) < 1_000_000


def hang(monkeypatch: pytest.MonkeyPatch, release: threading.Event, times: int) -> list[int]:
    """Let SVT hang at the third frame, so often; return a list of the runs."""
    runs: list[int] = []
    encode = svt.encode_once

    def sometimes(frames: Any, out: Path, options: EncodeOptions, tell: Any) -> list[int]:
        runs.append(len(runs))
        if len(runs) > times:
            return encode(frames, out, options, tell)

        def stop(done: int, total: int | None) -> None:
            tell(done, total)
            if done == 3:
                release.wait()

        return encode(frames, out, options, stop)

    monkeypatch.setattr(svt, "encode_once", sometimes)
    monkeypatch.setattr(svt, "PATIENCE", 0.5)
    monkeypatch.setattr("mvmatch.encode.watch._FAREWELL", 0.1)
    return runs


def test_an_encoder_that_stops_is_started_anew(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, release: threading.Event
) -> None:
    expected = encode_video(data / "svt_flat_p8.mkv", tmp_path / "expected.ivf")
    runs = hang(monkeypatch, release, times=1)
    found = encode_video(data / "svt_flat_p8.mkv", tmp_path / "found.ivf")
    assert len(runs) == 2
    assert found.num_frames == expected.num_frames
    assert found.path.read_bytes() == expected.path.read_bytes()


def test_an_encoder_that_never_works_is_named(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, release: threading.Event
) -> None:
    runs = hang(monkeypatch, release, times=9)
    with pytest.raises(MvmatchError, match="SVT-AV1 stopped working 3 times"):
        encode_video(data / "svt_flat_p8.mkv", tmp_path / "found.ivf")
    assert len(runs) == 3
    assert list(tmp_path.iterdir()) == []
