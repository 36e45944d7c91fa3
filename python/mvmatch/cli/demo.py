"""The verb that needs no input."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from mvmatch.cli.console import Outcome, Ticker
from mvmatch.cli.runs import run_outcome
from mvmatch.cli.settings import Json, Settings


def demo(
    out: Path = Path("demo"),
    /,
    *,
    frames: int = 40,
    settings: Settings | None = None,
    json: Json = False,
) -> Outcome:
    """Render a short synthetic drive, reconstruct it, and compare the path with the truth.

    Parameters
    ----------
    out
        Folder for frames, truth, database, model and report.
    frames
        Frames to render.
    """
    from mvmatch.demo import run_demo

    with Ticker() as tell:
        made = run_demo(
            out, num_frames=frames, options=(settings or Settings()).options(), progress=tell
        )
    outcome = run_outcome(made.run)
    if made.error is None:
        return outcome
    error = made.error
    told = (
        f"{error.percent_of_path:.3f} % of the path: camera centres are {1000 * error.rmse:.1f} mm "
        f"(RMS) from the truth over {error.path_length:.1f} m"
    )
    return dataclasses.replace(outcome, figures={**outcome.figures, "accuracy": told})
