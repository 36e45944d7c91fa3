"""The verbs that measure."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from cyclopts import App

from mvmatch.cli.console import Outcome
from mvmatch.cli.protocol import paper
from mvmatch.cli.settings import Json, Output

app = App(name="bench", sort_key=100, help="Measure methods against the truth (docs/accuracy.md).")
app.command(paper)
app.default(paper)  # `mvmatch bench configs/paper.toml --data FOLDER`


@app.command
def accuracy(
    *,
    data: list[Path],
    out: Output = Path("out/accuracy"),
    sequences: str = "",
    methods: str = "",
    frames: int = 30,
    gaps: str = "1,2,5,10",
    draws: int = 5,
    map: bool = False,  # noqa: A002
    json: Json = False,
) -> Outcome:
    """Compare point matches and poses of several methods with the truth.

    What is computed already is kept: a run that was interrupted goes on where it was.

    Parameters
    ----------
    data
        Folders that are sequences or hold some; can be repeated.
    out
        Folder for tables, results and streams.
    sequences
        Names, separated by commas; NAME+COMPOSITION for a composed one (repeats, cut, overlay, pan,
        shake, movers, 1080p). Without it all of them as they are.
    methods
        Names, separated by commas, such as svt-default, svt-paper, svt-refined, libaom-rt-default,
        libaom-good-default, klt, dis, sift, or patterns: "svt-default*" is preset default with one
        part off at a time.
    frames
        First frames of each sequence; 0 for all.
    gaps
        Frames between the two of a pair, separated by commas; SIFT is matched up to 10.
    draws
        Resamplings for the error bars.
    map
        Also reconstruct and measure trajectories: slow.
    """
    from mvmatch.bench.accuracy import AccuracyOptions
    from mvmatch.bench.report import TABLES, write_tables
    from mvmatch.bench.run import Cell, RunOptions, run_cells

    def tell(cell: Cell, state: str) -> None:
        print(f"{cell.sequence} {cell.method}: {state}", file=sys.stderr, flush=True)

    options = RunOptions(
        data=tuple(data),
        out=out,
        sequences=_words(sequences),
        methods=_words(methods) or RunOptions.methods,
        max_frames=frames or None,
        map=map,
        accuracy=AccuracyOptions(gaps=tuple(int(gap) for gap in _words(gaps)), draws=draws),
    )
    results = run_cells(options, tell=tell)
    made = write_tables(results, options)
    failed = [f"{each['sequence']} {each['method']}" for each in results if each["error"]]
    return Outcome(
        made=made,
        figures={"results": str(len(results)), "failed": ", ".join(failed) or "none"},
        table=(out / TABLES).read_text(encoding="utf-8"),
    )


@app.command
def confidence(
    *,
    data: list[Path],
    out: Output = Path("out/confidence"),
    sequences: str = "",
    encoders: str = "",
    qualities: str = "",
    frames: int = 60,
    json: Json = False,
) -> Outcome:
    """Compare the confidence in motion vectors with how many of them are right.

    Encoded streams are kept. Only sequences with exact point truth can be used.

    Parameters
    ----------
    data
        Folders that are sequences or hold some; can be repeated.
    out
        Folder for the table, the diagram and streams.
    sequences
        Names, separated by commas; NAME+COMPOSITION for a composed one. Without it all of them as
        they are.
    encoders
        Names, separated by commas, of svt, libaom-rt, libaom-good; all without.
    qualities
        CRF values, separated by commas; the encoders' default without.
    frames
        First frames of each sequence, of which every third is used; 0 for all.
    """
    from mvmatch.bench.reliability import ReliabilityOptions, measure
    from mvmatch.bench.reliability_report import TABLE, write_reliability

    options = ReliabilityOptions(
        data=tuple(data),
        out=out,
        sequences=_words(sequences),
        encoders=_words(encoders) or ReliabilityOptions.encoders,
        qualities=tuple(int(word) for word in _words(qualities)) or ReliabilityOptions.qualities,
        max_frames=frames or None,
    )
    results: list[Any] = []
    for stream, reliability in measure(options):
        print(f"{stream.sequence} {stream.encoder} {stream.quality}", file=sys.stderr, flush=True)
        results.append((stream, reliability))
    made = write_reliability(results, options)
    return Outcome(
        made=made,
        figures={"streams": str(len(results))},
        table=(out / TABLE).read_text(encoding="utf-8"),
    )


@app.command
def sfm(
    *,
    data: list[Path],
    out: Output = Path("out/sfm"),
    sequences: str = "",
    methods: str = "",
    known: bool | None = None,
    unknown: bool | None = None,
    resamplings: int = 0,
    frames: int = 0,
    timeout: float = 3600.0,
    json: Json = False,
) -> Outcome:
    """Compare whole runs, from input to model, with SIFT: what they make and what they cost.

    Each run is a process of its own. What is computed already is kept: a benchmark that was
    interrupted goes on where it was.

    Parameters
    ----------
    data
        Folders that are sequences or hold some; can be repeated.
    out
        Folder for tables, results, streams and models.
    sequences
        Names, separated by commas; NAME+COMPOSITION for a composed one. Without it all of them as
        they are.
    methods
        Names or patterns, separated by commas: svt, libaom-rt or libaom-good with -default, -dense,
        -fast or -paper; sift (COLMAP's mapper as it is), sift-video (with bounds for video),
        sift-checked (the mapper of mvmatch run). All without.
    known
        Only with the camera of the sequence; --no-known is --unknown.
    unknown
        Only without a camera; --no-unknown is --known. Both with neither.
    resamplings
        Further mappings, each without 20 % of the keypoints (or tracks).
    frames
        First frames of each sequence; 0 for all.
    timeout
        Seconds after which a run is ended.
    """
    from mvmatch.bench.sfm import SfmCell, SfmOptions, run_sfm, sfm_cells
    from mvmatch.bench.sfm_clouds import CloudsCell, compare_clouds
    from mvmatch.bench.sfm_report import TABLES, write_sfm_tables

    def tell(cell: SfmCell | CloudsCell, state: str) -> None:
        print(f"{cell.name}: {state}", file=sys.stderr, flush=True)

    options = SfmOptions(
        data=tuple(data),
        out=out,
        sequences=_words(sequences),
        methods=_words(methods) or SfmOptions.methods,
        intrinsics=_intrinsics(known, unknown),
        max_frames=frames or None,
        resamplings=resamplings,
        timeout_s=timeout,
    )
    results = run_sfm(options, tell=tell)
    clouds = compare_clouds(sfm_cells(options), results, tell=tell)
    made = write_sfm_tables(results, clouds, options)
    failed = [
        f"{each['sequence']} {each['method']} {each['intrinsics']}"
        for each in results
        if each["error"]
    ]
    return Outcome(
        made=made,
        figures={"results": str(len(results)), "failed": ", ".join(failed) or "none"},
        data={"cells": results, "clouds": clouds},
        table=(out / TABLES).read_text(encoding="utf-8"),
    )


def _intrinsics(known: bool | None, unknown: bool | None) -> tuple[Any, ...]:
    """Return what is left of both when one is asked for, or the other is not wanted."""
    asked = {"known": known, "unknown": unknown}
    only = tuple(name for name, wanted in asked.items() if wanted)
    return only or tuple(name for name, wanted in asked.items() if wanted is None)


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())
