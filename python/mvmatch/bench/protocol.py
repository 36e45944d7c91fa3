"""The protocol of the paper on sequences: every method in a fresh process that is sampled.

A cell is one (sequence, method). One process writes the frames and encodes them; a second one
matches, verifies and maps, and judges what it made when the measured part is over. What fails, runs
too long or cannot run here is a cell with its reason.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvmatch.bench.apart import run_apart
from mvmatch.bench.digests import code_digest, folder_digest
from mvmatch.bench.protocol_judge import judge_pairs, map_database, verify_matches
from mvmatch.bench.protocol_methods import METHODS, Timeline, VectorMethod, described
from mvmatch.bench.protocol_options import ProtocolOptions, settings
from mvmatch.bench.run import (
    CELLS,
    SCRATCH,
    chosen_methods,
    chosen_sequences,
    open_sequence,
    prepare_clip,
)
from mvmatch.bench.sampling import TreeSampler
from mvmatch.bench.sfm_judge import judge_model
from mvmatch.bench.store import Result, fill_cells
from mvmatch.outputs import provenance
from mvmatch.report.plain import plain

if TYPE_CHECKING:
    from collections.abc import Callable
    from collections.abc import Sequence as Many

_JUDGES = (
    "bench/apart.py", "bench/compose.py", "bench/datasets", "bench/mapping.py", "bench/matches.py",
    "bench/protocol.py", "bench/protocol_judge.py", "bench/protocol_methods.py",
    "bench/sampling.py", "bench/sfm_judge.py", "camera", "export", "geometry", "pairing.py",
    "rows.py", "sfm", "types.py",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ProtocolCell:
    """One (sequence, method) to be computed."""

    sequence: str
    method: str
    folder: Path
    """Of the base sequence."""
    out: Path
    """Folder of the benchmark."""
    options: ProtocolOptions

    @property
    def path(self) -> Path:
        """File of the result."""
        return self.out / CELLS / self.sequence / f"{self.method}.json"

    @property
    def work(self) -> Path:
        """Folder of the database and the model."""
        return self.out / SCRATCH / "protocol" / self.sequence / self.method

    @property
    def key(self) -> str:
        """Digest of everything the result depends on: settings, poses, and the code involved."""
        code = sorted({*_JUDGES, *METHODS[self.method].sources})
        values = [self.sequence, described(self.method), settings(self.options)]
        digest = hashlib.sha256(json.dumps(plain(values), sort_keys=True).encode())
        digest.update(code_digest(code).encode())
        digest.update(folder_digest(self.folder).encode())
        return digest.hexdigest()


def protocol_cells(options: ProtocolOptions, data: Many[Path], out: Path) -> list[ProtocolCell]:
    """Return the cells of a benchmark, sequence by sequence.

    Raises
    ------
    DataError
        A sequence or method is not known.
    """
    methods = chosen_methods(options.methods, METHODS)
    return [
        ProtocolCell(sequence=name, method=method, folder=folder, out=out, options=options)
        for name, folder in chosen_sequences(data, options.sequences)
        for method in methods
    ]


def run_protocol(
    options: ProtocolOptions,
    data: Many[Path],
    out: Path,
    *,
    tell: Callable[[ProtocolCell, str], None] | None = None,
) -> list[Result]:
    """Compute all cells that are not there yet and return all of them.

    Parameters
    ----------
    options : ProtocolOptions
        What is run.
    data : sequence of Path
        Folders that are sequences or hold some.
    out : Path
        Folder of results, streams and models.
    tell : callable, optional
        Told about every cell: ``"kept"`` or ``"running"`` before, ``"done"`` or the reason it
        failed after.

    Returns
    -------
    list of dict
        As in the files: ``sequence``, ``method``, ``key``, ``error`` (None or the reason),
        ``settings`` of the method, ``encoding`` (``seconds``, ``cpu_seconds``, ``num_bytes``; None
        where frames are read), ``size`` and ``num_frames``, ``stages`` (:class:`Timeline`),
        ``reading``, ``rows`` (:func:`judge_pairs`), ``adjacency`` (:func:`verify_matches`, and
        ``linked`` of :meth:`VectorMethod.linked` or None), ``model`` (None without mapping),
        ``usage`` (:func:`_usage`), and the provenance.
    """
    return fill_cells(protocol_cells(options, data, out), compute_cell, tell)


def compute_cell(cell: ProtocolCell) -> Result:
    """Prepare, run and judge one cell; what goes wrong is its ``error``."""
    head: Result = {
        "sequence": cell.sequence, "method": cell.method, "key": cell.key, "error": None,
        "settings": plain(described(cell.method)), "encoding": None, "size": None, "num_frames": 0,
        "stages": [], "reading": None, "rows": [], "adjacency": None, "model": None, "usage": None,
        **provenance(),
    }  # fmt: skip
    reason = METHODS[cell.method].unavailable()
    if reason is not None:
        return head | {"error": f"not run: {reason}"}
    prepared = run_apart(_prepare, cell, timeout_s=cell.options.timeout_s)
    if prepared.error is not None:
        return head | {"error": f"preparing: {prepared.error}"}
    head |= prepared.value
    sampler, begin = TreeSampler(cell.options.interval_s), time.monotonic()
    apart = run_apart(_measure, cell, timeout_s=cell.options.timeout_s, sampler=sampler)
    return head | {"error": apart.error, **apart.value, "usage": _usage(sampler, begin, apart)}


def _prepare(cell: ProtocolCell) -> dict[str, Any]:
    """Write the frames of a sequence, and encode them for methods that read vectors."""
    frames = cell.options.max_frames
    sequence = open_sequence(cell.folder, cell.sequence, frames)
    clip = prepare_clip(sequence, cell.folder, cell.out, frames)
    encoding = METHODS[cell.method].prepare(clip)
    return {"encoding": encoding, "size": sequence.size, "num_frames": len(sequence)}


def _measure(cell: ProtocolCell) -> dict[str, Any]:
    """Run a method, then judge it."""
    options, method, timeline = cell.options, METHODS[cell.method], Timeline()
    sequence = open_sequence(cell.folder, cell.sequence, options.max_frames)
    clip = prepare_clip(sequence, cell.folder, cell.out, options.max_frames)
    shutil.rmtree(cell.work, ignore_errors=True)
    cell.work.mkdir(parents=True)
    database = cell.work / "database.db"
    names = [path.name for path in sorted(clip.images.iterdir())]

    matches = method.run(clip, timeline, options.threads)
    adjacency = verify_matches(
        matches, sequence, database, names, timeline=timeline, options=options
    )
    model = map_database(database, matches, sequence, timeline) if options.map else None
    end = time.monotonic()

    if model is not None:
        path = None if model["path"] is None else Path(model["path"])
        model |= judge_model(path, sequence, cloud=False)
    linked = method.linked(clip, options.threads) if isinstance(method, VectorMethod) else None
    return {
        "stages": timeline.stages,
        "end_s": end,
        "reading": method.reading(clip, options.threads),
        "rows": judge_pairs(matches, sequence, options),
        "adjacency": adjacency | {"linked": linked},
        "model": model,
    }


def _usage(sampler: TreeSampler, begin: float, apart: Any) -> dict[str, Any]:
    """Return what the measured part used, and what the process did in all.

    Returns
    -------
    dict
        ``begin_s`` (monotonic clock), ``processors`` of the machine, ``samples`` (``time_s`` from
        then on, ``cpu_s``, ``rss_mb``) up to the end of the measured part, ``peak_rss_mb`` of them,
        and ``wall_s``, ``cpu_s`` and ``sampler_cpu_s`` of the whole process, judging included.
    """
    end = apart.value.get("end_s", float("inf"))
    samples = [
        asdict(sample) | {"time_s": sample.time_s - begin}
        for sample in sampler.samples
        if sample.time_s <= end + sampler.interval_s
    ]
    return {
        "begin_s": begin,
        "processors": os.cpu_count(),
        "samples": samples,
        "peak_rss_mb": max((sample["rss_mb"] for sample in samples), default=None),
        "wall_s": apart.wall_s,
        "cpu_s": apart.cpu_s,
        "sampler_cpu_s": sampler.own_cpu_s,
    }
