"""Whole runs from input to model, each in a fresh process, side by side with SIFT.

A cell is one (sequence, method, intrinsics). Three processes make it: one writes the frames and
encodes them, one is the run, measured from outside, and one judges what it left. The run is kept
beside the result: judging otherwise does not repeat it.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mvmatch.bench.apart import run_apart
from mvmatch.bench.digests import code_digest, folder_digest
from mvmatch.bench.front_ends import encoded_stream
from mvmatch.bench.matches import Sample
from mvmatch.bench.run import (
    CELLS,
    SCRATCH,
    chosen_methods,
    chosen_sequences,
    open_sequence,
    prepare_clip,
)
from mvmatch.bench.sfm_judge import Draws, judge_model
from mvmatch.bench.sfm_methods import METHODS, Input, VectorRun, sources_of
from mvmatch.bench.store import Result, fill_cells, stored, write_json
from mvmatch.errors import DataError
from mvmatch.outputs import provenance
from mvmatch.report.plain import plain

if TYPE_CHECKING:
    from collections.abc import Callable

Intrinsics = Literal["known", "unknown"]

_PREPARATION = ("bench/compose.py", "bench/datasets", "encode")
_JUDGES = (
    "bench/cloud.py", "bench/mapping.py", "bench/matches.py", "bench/sfm.py", "bench/sfm_judge.py",
    "bench/truth.py", "geometry",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class SfmOptions:
    """What is run."""

    data: tuple[Path, ...]
    """Folders that are sequences or hold some."""
    out: Path
    sequences: tuple[str, ...] = ()
    """Names, with ``+composition`` for composed ones; empty: every sequence as it is."""
    methods: tuple[str, ...] = ("sift*", "svt-*", "libaom-*")
    """Names, or patterns as of file names."""
    intrinsics: tuple[Intrinsics, ...] = ("known", "unknown")
    """``known`` gives the camera of the sequence, ``unknown`` none."""
    max_frames: int | None = None
    resamplings: int = 0
    """Further mappings, each without a share of the keypoints (or tracks)."""
    kept: float = 0.8
    """Share that a resampling keeps."""
    timeout_s: float = 3600.0
    """Elapsed time after which a run, or its judgement, is ended."""


@dataclass(frozen=True, kw_only=True)
class SfmCell:
    """One (sequence, method, intrinsics) to be computed."""

    sequence: str
    method: str
    intrinsics: Intrinsics
    folder: Path
    """Of the base sequence."""
    options: SfmOptions

    @property
    def name(self) -> str:
        """What progress is told under."""
        return f"{self.sequence} {self.method} {self.intrinsics}"

    @property
    def path(self) -> Path:
        """File of the result."""
        return self.options.out / CELLS / self.sequence / f"{self.method}-{self.intrinsics}.json"

    @property
    def work(self) -> Path:
        """Folder of what the run leaves, and of the record of its cost."""
        name = f"{self.method}-{self.intrinsics}"
        return self.options.out / SCRATCH / "runs" / self.sequence / name

    @property
    def run_key(self) -> str:
        """Digest of everything the run depends on."""
        sources = sorted({*sources_of(self.method), *_PREPARATION})
        return self._digest(METHODS[self.method], self.options.max_frames, code_digest(sources))

    @property
    def draw_key(self) -> str:
        """Digest of everything a resampling of the run depends on, but for its number."""
        return self._digest(self.run_key, self.options.kept, code_digest(_JUDGES))

    @property
    def key(self) -> str:
        """Digest of everything the result depends on."""
        return self._digest(self.draw_key, self.options.resamplings)

    def _digest(self, *values: Any) -> str:
        own = [self.sequence, self.method, self.intrinsics, folder_digest(self.folder)]
        return hashlib.sha256(json.dumps(plain([*own, *values])).encode()).hexdigest()


def sfm_cells(options: SfmOptions) -> list[SfmCell]:
    """Return the cells of a benchmark, sequence by sequence.

    Raises
    ------
    DataError
        A sequence or method is not known, or no intrinsics are asked for.
    """
    if not options.intrinsics:
        raise DataError("neither known nor unknown intrinsics are asked for: name one of them")
    methods = chosen_methods(options.methods, METHODS)
    return [
        SfmCell(sequence=name, method=method, intrinsics=intrinsics, folder=folder, options=options)
        for name, folder in chosen_sequences(options.data, options.sequences)
        for intrinsics in options.intrinsics
        for method in methods
    ]


def run_sfm(
    options: SfmOptions, *, tell: Callable[[SfmCell, str], None] | None = None
) -> list[Result]:
    """Compute all cells that are not there yet and return all of them.

    Parameters
    ----------
    options : SfmOptions
        What to run.
    tell : callable, optional
        Told about every cell: ``"kept"`` or ``"running"`` before, ``"done"`` or the reason it
        failed after.

    Returns
    -------
    list of dict
        As in the files: ``sequence``, ``method``, ``intrinsics``, ``key``, ``error`` (None or the
        reason), ``total`` pictures, ``encoding`` (``seconds``, ``cpu_seconds``, ``num_bytes``; None
        where images are read), ``run`` (``wall_s``, ``cpu_s``, ``peak_rss_mb``, ``accepted``,
        ``registered``, ``reasons``, ``stages``), ``model`` (:func:`judge_model`), ``draws``
        (:meth:`Draws.judged`), and the provenance.
    """
    return fill_cells(sfm_cells(options), compute_cell, tell)


def compute_cell(cell: SfmCell) -> Result:
    """Prepare, run and judge one cell; what goes wrong is its ``error``."""
    head: Result = {
        "sequence": cell.sequence, "method": cell.method, "intrinsics": cell.intrinsics,
        "key": cell.key, "error": None, "total": 0, "encoding": None, "run": {}, "model": {},
        "draws": [], **provenance(),
    }  # fmt: skip
    prepared = run_apart(_prepare, cell, timeout_s=cell.options.timeout_s)
    if prepared.error is not None:
        return head | {"error": f"preparing: {prepared.error}"}
    facts = prepared.value
    head |= {"total": facts["total"], "encoding": facts["encoding"]}
    given = Input(path=Path(facts["path"]), size=tuple(facts["size"]), camera=facts["camera"])
    run = _measured(cell, given)
    head["run"] = {name: value for name, value in run.items() if name not in {"key", "error"}}
    if run["error"] is not None:
        return head | {"error": run["error"]}
    judged = run_apart(_judge, cell, given, run["model"], timeout_s=cell.options.timeout_s)
    if judged.error is not None:
        return head | {"error": f"judging: {judged.error}"}
    return head | judged.value


def _measured(cell: SfmCell, given: Input) -> Result:
    """Run a method, or return what it cost and made when it did."""
    record = cell.work / "run.json"
    run = stored(record, cell.run_key)
    if run is not None:
        return run
    shutil.rmtree(cell.work, ignore_errors=True)
    cell.work.mkdir(parents=True)
    apart = run_apart(_run, cell, given, timeout_s=cell.options.timeout_s)
    cost = {"wall_s": apart.wall_s, "cpu_s": apart.cpu_s, "peak_rss_mb": apart.peak_rss_mb}
    run = {"key": cell.run_key, "error": apart.error, **cost, **apart.value}
    write_json(record, run)
    return run


def _prepare(cell: SfmCell) -> dict[str, Any]:
    """Write the frames of a sequence, and encode them for methods that read vectors."""
    sequence = open_sequence(cell.folder, cell.sequence, cell.options.max_frames)
    clip = prepare_clip(sequence, cell.folder, cell.options.out, cell.options.max_frames)
    method, path, encoding = METHODS[cell.method], clip.images, None
    if isinstance(method, VectorRun):
        path, encoding = encoded_stream(clip, method.encode)
    camera, size = sequence.camera, sequence.size
    numbers = [*size, *(float(value) for value in camera.params)]
    text = ",".join([camera.model_name, *map(repr, numbers)])
    return {
        "path": str(path),
        "size": size,
        "camera": text if cell.intrinsics == "known" else None,
        "encoding": encoding,
        "total": len(sequence),
    }


def _run(cell: SfmCell, given: Input) -> dict[str, Any]:
    return METHODS[cell.method].run(given, cell.work / "out")


def _judge(cell: SfmCell, given: Input, model: str | None) -> dict[str, Any]:
    options = cell.options
    sequence = open_sequence(cell.folder, cell.sequence, options.max_frames)
    samples = [Sample(share=options.kept, seed=seed) for seed in range(options.resamplings)]
    draws = Draws(
        method=METHODS[cell.method],
        given=given,
        out=cell.work / "out",
        sequence=sequence,
        store=cell.work / "draws",
        key=cell.draw_key,
    )
    return {
        "model": judge_model(None if model is None else Path(model), sequence),
        "draws": [draws.judged(sample) for sample in samples],
    }
