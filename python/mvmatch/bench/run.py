"""Run front ends on sequences, one file per cell, so that an interrupted run goes on where it was.

A cell is one (sequence, method). It is computed in a process of its own: a method that crashes,
even the interpreter, leaves a cell that says so.
"""

from __future__ import annotations

import dataclasses
import fnmatch
import hashlib
import json
import shutil
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from mvmatch.bench.accuracy import AccuracyOptions, draws_of, judge
from mvmatch.bench.apart import run_apart
from mvmatch.bench.compose import COMPOSITIONS
from mvmatch.bench.datasets import Sequence, find_sequences, load_sequence, write_frames
from mvmatch.bench.digests import code_digest, folder_digest
from mvmatch.bench.front_ends import FRONT_ENDS, Clip, sources_of
from mvmatch.bench.mapping import map_matches
from mvmatch.bench.store import fill_cells
from mvmatch.errors import DataError
from mvmatch.measure import peak_rss_mb
from mvmatch.outputs import provenance
from mvmatch.report.plain import plain

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from collections.abc import Sequence as Many
    from pathlib import Path

CELLS, SCRATCH = "cells", "scratch"
"""Folders of a run: results, and streams and databases that can be made anew."""

_JUDGES = (
    "bench/accuracy.py", "bench/compose.py", "bench/datasets", "bench/front_ends.py",
    "bench/matches.py", "bench/truth.py", "camera", "geometry", "pairing.py",
    "rows.py", "types.py",
)  # fmt: skip
_MAPPERS = ("bench/mapping.py", "export", "sfm")


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """What is run."""

    data: tuple[Path, ...]
    """Folders that are sequences or hold some."""
    out: Path
    sequences: tuple[str, ...] = ()
    """Names, with ``+composition`` for composed ones; empty: every sequence as it is."""
    methods: tuple[str, ...] = ("svt-default", "svt-paper", "klt", "dis", "sift")
    """Names, or patterns as of file names: ``svt-default*`` is the default and its ablations."""
    max_frames: int | None = 30
    map: bool = False
    """Also reconstruct, all points and every draw: slow."""
    accuracy: AccuracyOptions = field(default_factory=AccuracyOptions)


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One (sequence, method) to be computed."""

    sequence: str
    method: str
    folder: Path
    """Of the base sequence."""
    options: RunOptions

    @property
    def path(self) -> Path:
        """File of the result."""
        return self.options.out / CELLS / self.sequence / f"{self.method}.json"

    @property
    def key(self) -> str:
        """Digest of everything the result depends on: settings, poses, and the code involved."""
        code = (*_JUDGES, *sources_of(self.method), *(_MAPPERS if self.options.map else ()))
        settings = {
            "accuracy": dataclasses.asdict(self.options.accuracy),
            "max_frames": self.options.max_frames,
            "map": self.options.map,
        }
        digest = hashlib.sha256(json.dumps(plain(settings), sort_keys=True).encode())
        digest.update(code_digest(code).encode())
        digest.update(folder_digest(self.folder).encode())
        return digest.hexdigest()


def cells_of(options: RunOptions) -> list[Cell]:
    """Return the cells of a run, sequence by sequence.

    Raises
    ------
    DataError
        A sequence or method is not known.
    """
    methods = chosen_methods(options.methods, FRONT_ENDS)
    return [
        Cell(sequence=name, method=method, folder=folder, options=options)
        for name, folder in chosen_sequences(options.data, options.sequences)
        for method in methods
    ]


def chosen_methods(patterns: Many[str], known: Iterable[str]) -> list[str]:
    """Return the methods that match names or patterns, each once.

    Raises
    ------
    DataError
        A pattern matches none.
    """
    known = list(known)
    methods: dict[str, None] = {}
    for pattern in patterns:
        matching = fnmatch.filter(known, pattern)
        if not matching:
            raise DataError(f"there is no method {pattern}; there are {', '.join(known)}")
        methods.update(dict.fromkeys(matching))
    return list(methods)


def chosen_sequences(data: Many[Path], names: Many[str]) -> list[tuple[str, Path]]:
    """Return names of sequences, composed ones too, and the folder of each base.

    Without names these are all sequences of the folders ``data`` as they are.

    Raises
    ------
    DataError
        A sequence or a composition is not known.
    """
    folders = find_sequences(data)
    chosen: list[tuple[str, Path]] = []
    for name in names or tuple(folders):
        base, plus, composition = name.partition("+")
        if base not in folders:
            raise DataError(f"there is no sequence {base}; there are {', '.join(folders)}")
        if plus and composition not in COMPOSITIONS:
            raise DataError(
                f"there is no composition {composition}; there are {', '.join(COMPOSITIONS)}"
            )
        chosen.append((name, folders[base]))
    return chosen


def run_cells(
    options: RunOptions, *, tell: Callable[[Cell, str], None] | None = None
) -> list[dict[str, Any]]:
    """Compute all cells of a run that are not there yet and return all of them.

    Parameters
    ----------
    options : RunOptions
        What to run.
    tell : callable, optional
        Told about every cell: ``"kept"`` or ``"running"`` before, ``"done"`` or the reason it
        failed after.

    Returns
    -------
    list of dict
        As in the files: ``sequence``, ``method``, ``key``, ``error`` (None or the reason),
        ``rows``, ``models``, ``cost``, and the provenance of each.
    """
    return fill_cells(cells_of(options), _isolated, tell)


def compute_cell(cell: Cell) -> dict[str, Any]:
    """Run one front end on one sequence and judge it; no error of it gets out."""
    try:
        sequence = open_sequence(cell.folder, cell.sequence, cell.options.max_frames)
        clip = prepare_clip(sequence, cell.folder, cell.options.out, cell.options.max_frames)
        found = FRONT_ENDS[cell.method](clip)
        rows = judge(found.matches, sequence, cell.options.accuracy)
        lengths = found.matches.lengths()
        models = []
        if cell.options.map:
            samples = draws_of(cell.options.accuracy)
            models = [map_matches(found.matches, sequence, clip, sample) for sample in samples]
    except Exception as error:
        return _result(cell, error=f"{type(error).__name__}: {error}")
    return _result(
        cell,
        rows=rows,
        models=models,
        cost=found.cost,
        details=found.details,
        num_frames=len(sequence),
        track_lengths=None if lengths is None else np.bincount(lengths).tolist(),
        peak_rss_mb=peak_rss_mb(),
    )


def open_sequence(folder: Path, name: str, max_frames: int | None) -> Sequence:
    """Load a sequence, compose it if its name says so, and cut it to ``max_frames``."""
    sequence = load_sequence(folder).first(max_frames)
    composition = name.partition("+")[2]
    if composition:
        sequence = COMPOSITIONS[composition](sequence).first(max_frames)
    return sequence


def prepare_clip(sequence: Sequence, folder: Path, out: Path, max_frames: int | None) -> Clip:
    """Write the frames of a sequence where its methods find them, unless they are there.

    Parameters
    ----------
    sequence : Sequence
        As :func:`open_sequence` gives it.
    folder : Path
        Of the base sequence.
    out : Path
        Folder of the run.
    max_frames : int or None
        What the sequence was cut to.
    """
    frames = "all" if max_frames is None else str(max_frames)
    code = code_digest(("bench/compose.py", "bench/datasets", "encode"))[:8]
    made_of = f"{folder_digest(folder)[:8]}-{code}"
    scratch = out / SCRATCH / f"{sequence.name}-{frames}-{made_of}"
    images = scratch / "images"
    if not images.is_dir():
        partial = scratch / "images.partial"
        shutil.rmtree(partial, ignore_errors=True)
        write_frames(sequence, partial)
        partial.replace(images)
    return Clip(images=images, num_frames=len(sequence), camera=sequence.camera, scratch=scratch)


def _isolated(cell: Cell) -> dict[str, Any]:
    apart = run_apart(compute_cell, cell)
    return apart.value if apart.error is None else _result(cell, error=apart.error)


def _result(cell: Cell, *, error: str | None = None, **values: Any) -> dict[str, Any]:
    result: dict[str, Any] = {
        "sequence": cell.sequence, "method": cell.method, "key": cell.key, "error": error,
        "rows": [], "models": [], "cost": {}, "details": {},
    }  # fmt: skip
    return result | values | provenance()
