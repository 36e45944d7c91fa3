"""Reads files, compares them with their goldens and remembers what was compared where."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.errors import MvmatchError, UnsupportedError
from mvmatch.sources import open_video
from mvmatch.sources.av1 import Av1Source
from oracle.cells import compare_cells
from oracle.damage import Demand
from oracle.headers import COLUMNS, compare_headers
from oracle.record import Record

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from mvmatch._core import CodedFrame


# What a unit that is sent twice changes in the records from its second coming on. Everything else
# is the same as long as its frames do not refer to the slots that they fill.
RENUMBERED = {"f_tu", "f_decode_idx", "f_sef_slot", "ref_decode_idx"}
RENUMBERED |= {"slot_decode_idx", "slot_order_hint"}


def frames_of(path: Path) -> Iterator[CodedFrame]:
    """Every frame of a file, through the door that users take."""
    with open_video(path) as video:
        assert isinstance(video, Av1Source)
        for frame, _ in video.coded_frames():
            yield frame


def refers_to_itself(golden: dict[str, np.ndarray], unit: int) -> bool:
    """Whether the frames of a unit refer to slots that they fill."""
    own = golden["f_tu"] == unit
    filled = int(np.bitwise_or.reduce(golden["f_refresh_frame_flags"][own], initial=0))
    used = golden["ref_slot"][own].ravel()
    return any(filled >> int(slot) & 1 for slot in used[used >= 0])


class Report:
    """What the streams have shown so far."""

    def __init__(self) -> None:
        self.known: set[str] = set()
        self.compared: Counter[str] = Counter()
        """Records in which an array was compared."""
        self.left_out: Counter[str] = Counter()
        """Records in which no golden defines it."""

    def check(self, path: Path, golden_path: Path, demand: Demand | None = None) -> tuple[str, str]:
        """Verdict on a file, and the details. Without a demand it is an intact stream."""
        golden = dict(np.load(golden_path))
        self.known |= set(golden)
        demand = demand or Demand()
        required = total = len(golden["f_rec"])
        if demand.intact is not None:
            required = int(np.count_nonzero(golden["f_tu"] < demand.intact))
        repeated = 0
        if demand.repeats_last and demand.intact:
            repeated = int(np.count_nonzero(golden["f_tu"] == demand.intact - 1))
            if not refers_to_itself(golden, demand.intact - 1):
                demand = replace(demand, ends="whole", free_records=0)
        outcome = Outcome(demand, total, required, repeated)
        try:
            for frame in frames_of(path):
                if outcome.is_judged():
                    self._compare(frame, golden, outcome)
                outcome.count += 1
        except MvmatchError as raised:
            outcome.error = raised
        except BaseException as raised:
            if isinstance(raised, KeyboardInterrupt):
                raise
            return "PANIC", f"after {outcome.count} records: {raised!r}"
        return outcome.verdict()

    def _compare(self, frame: CodedFrame, golden: dict[str, np.ndarray], outcome: Outcome) -> None:
        unit, units = frame.unit_index, outcome.demand.units
        is_renumbered = outcome.count >= outcome.required and outcome.repeated > 0
        index = outcome.count - (outcome.repeated if is_renumbered else 0)
        record = Record(frame, golden, index, units.index(unit) if unit in units else unit)
        results = list(compare_headers(record))
        if frame.show_existing_frame == record.is_shown_again and not record.is_shown_again:
            results += compare_cells(record)
        for name, is_equal in results:
            if is_equal is None or (is_renumbered and name in RENUMBERED):
                self.left_out[name] += is_equal is None
                continue
            self.compared[name] += 1
            if not is_equal:
                outcome.wrong.setdefault(name, outcome.count)

    @property
    def not_compared(self) -> list[str]:
        """Arrays of the goldens that were compared nowhere."""
        return sorted(self.known - set(self.compared))

    def exceptions(self) -> Iterator[tuple[str, list[str]]]:
        """Say where and why records were left out, each time with the arrays it holds for."""
        found: dict[str, list[str]] = {}
        for column in COLUMNS:
            left_out = self.left_out[column.name]
            if left_out:
                share = f"compared in {self.compared[column.name]} records, not in {left_out}"
                found.setdefault(f"{share}: {column.reason}", []).append(column.name)
        yield from found.items()


@dataclass
class Outcome:
    """What reading one file gave."""

    demand: Demand
    total: int
    """Records of the golden."""
    required: int
    """Records before the damage, or all."""
    repeated: int = 0
    """Records that come twice."""
    count: int = 0
    """Records that came."""
    wrong: dict[str, int] = field(default_factory=dict)
    """First record in which an array differs."""
    error: Exception | None = None

    def is_judged(self) -> bool:
        """Whether the next record must equal the golden."""
        free = self.demand.free_records
        if self.demand.intact is None or self.count < self.required:
            return self.count < self.total
        return free is not None and free <= self.count < self.total + self.repeated

    def verdict(self) -> tuple[str, str]:
        """Judge what was read against what had to be read."""
        if self.wrong:
            details = ", ".join(f"{name} from record {first}" for name, first in self.wrong.items())
            return "DIFFERENT", f"{details}{f'; {self.error}' if self.error else ''}"
        if self.count < self.required:
            return "MISSING", f"{self.count} of {self.required} intact records: {self.error}"
        return self._read_to_the_end() if self.error is None else self._refused(self.error)

    def _refused(self, error: Exception) -> tuple[str, str]:
        if isinstance(error, UnsupportedError):
            return "UNSUPPORTED", str(error)
        if self.demand.ends == "whole":
            return "ERROR", f"after {self.count} records: {error!r}"
        return "refused", f"{type(error).__name__} behind {self.required} intact records"

    def _read_to_the_end(self) -> tuple[str, str]:
        expected = self.total + self.repeated
        if self.demand.ends == "refused":
            return "SILENT", f"{self.count} records, {self.required} intact, and no error"
        if self.demand.ends == "whole" and self.count != expected:
            return "RECORDS", f"{self.count} instead of {expected}"
        if self.demand.intact is None:
            return "equal", f"{self.count} records"
        return "read on", f"{self.count} records, {self.required} of them before the damage"
