"""The verb that does everything."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from mvmatch.cli.console import Outcome, Ticker
from mvmatch.cli.models import Camera, Mapper, look_at, model_figures, model_paths, with_mapper
from mvmatch.cli.settings import (
    BridgeMatcher,
    ExistingPath,
    Json,
    LoopMatcher,
    Output,
    Refine,
    Settings,
    UsageError,
    with_bridge,
    with_encoder,
    with_loops,
    with_refinement,
)
from mvmatch.encode import EncoderName

if TYPE_CHECKING:
    from mvmatch.pipeline import Run


def run(
    source: ExistingPath | None = None,
    /,
    *,
    out: Output = Path("out"),
    camera: Camera = None,
    encoder: EncoderName | None = None,
    mapper: Mapper = None,
    refine: Refine = None,
    bridge: BridgeMatcher = None,
    loops: LoopMatcher = None,
    re_encode: Annotated[bool, Parameter(negative="")] = False,
    masks: Annotated[bool, Parameter(negative="")] = False,
    undistort: Annotated[bool, Parameter(negative="")] = False,
    fresh: Annotated[bool, Parameter(negative="")] = False,
    print_config: Annotated[bool, Parameter(negative="")] = False,
    settings: Settings | None = None,
    json: Json = False,
) -> Outcome:
    """Everything: a video or a folder of frames in, a COLMAP model and a report out.

    Parameters
    ----------
    source
        An AV1 video, any other video FFmpeg decodes, or a folder of frames.
    out
        Folder for the results.
    encoder
        svt (always there), libaom, nvenc, qsv or vaapi; see `mvmatch encoders`.
    re_encode
        Encode AV1 input anew too.
    masks
        Write masks for COLMAP: moving objects and static overlays black.
    undistort
        Write OUT/undistorted for splatting and dense matching: images without distortion, with
        --masks their masks, and sparse/0 with their pinhole cameras.
    fresh
        Start over: use nothing that an earlier run into the same folder has finished.
    print_config
        Only print the effective options as TOML.
    """
    options = with_encoder((settings or Settings()).options(), encoder)
    options = with_loops(with_bridge(options, bridge), loops)
    options = with_mapper(with_refinement(options, refine), mapper)
    if print_config:
        from mvmatch.config import to_toml

        return Outcome(table=to_toml(options), data={"options": dataclasses.asdict(options)})
    if source is None:
        raise UsageError("run needs a video or a folder of frames")
    from mvmatch.pipeline import reconstruct_video

    with Ticker() as tell:
        made = reconstruct_video(
            source,
            out,
            camera=camera,
            options=options,
            reencode=re_encode,
            masks=masks,
            undistort=undistort,
            fresh=fresh,
            progress=tell,
        )
    return run_outcome(made)


def run_outcome(made: Run) -> Outcome:
    """Return what a whole run says at its end."""
    from mvmatch import outputs

    failure = _failure(made)
    warnings: list[str] = made.data["warnings"]
    if failure is made.match.damage is not None:
        warnings = [text for text in warnings if not text.startswith("The stream broke off")]
    return Outcome(
        made=[
            *model_paths(made.model),
            *(
                made.out / name
                for name in (outputs.DATABASE, outputs.MASKS, outputs.UNDISTORTED, outputs.PAGE)
                if (made.out / name).exists()
            ),
        ],
        figures={
            "video": f"{made.match.num_frames} pictures of {made.match.info.width}x"
            f"{made.match.info.height} px; camera: {made.camera.source}",
            "tracks": f"{len(made.match.tracks):,}{_aligned(made)}{_moving(made)}; "
            f"{made.database.num_inliers:,} matches in "
            f"{made.database.num_verified_pairs} image pairs",
            **_loops(made),
            **model_figures(made.model),
            **_dense(made),
            **_cost(made),
        },
        next=(
            f"open {made.out / outputs.PAGE}"
            if made.model.path is None
            else look_at(made.model.path, made.out / outputs.DATABASE, _images(made))
        ),
        data={key: value for key, value in made.data.items() if not key.startswith("adjacency")},
        warnings=warnings,
        failure=failure,
        partial=_partial(made),
        findings=[(each.sentence, each.advice) for each in made.diagnosis.findings],
    )


def _failure(made: Run) -> Exception | None:
    """Return why the model is not that of the whole video."""
    from mvmatch.errors import DataError

    model, advice = made.model, "What stands in the way, and what to try, follows"
    if not model.accepted:
        return DataError(f"no model holds: {', '.join(model.reasons)}. {advice}")
    if model.registered < model.total:
        return DataError(f"the model holds {model.registered} of {model.total} pictures. {advice}")
    return made.match.damage


def _cost(made: Run) -> dict[str, str]:
    """Return what this run cost, and what it took from one before."""
    stages: list[dict[str, Any]] = made.data["stages"]
    spent = [stage for stage in stages if not stage["reused"]]
    cost = ", ".join(f"{stage['name']} {stage['wall_s']:.1f} s" for stage in spent)
    figures: dict[str, str] = {}
    if made.reused:
        figures["reused"] = f"{', '.join(made.reused)} of an earlier run (--fresh starts over)"
    if spent:
        figures["cost"] = f"{cost}; {sum(stage['cpu_s'] for stage in spent):.1f} CPU s"
    return figures


def _loops(made: Run) -> dict[str, str]:
    """Return how many loops were closed, where they were looked for."""
    if made.data["loops"] is None:
        return {}
    found = len(made.match.loops)
    return {"loops": f"{found} image pairs far apart" if found else "no place was seen again"}


def _images(made: Run) -> Path:
    """Return where the pictures are, as far as they are files."""
    facts: dict[str, Any] = made.data["input"]
    return Path(facts["path"]) if facts["kind"] == "frames" else made.out


def _aligned(made: Run) -> str:
    return " aligned to the pictures" if made.match.is_refined else ""


def _dense(made: Run) -> dict[str, str]:
    """Return what further tracks became, where there were any."""
    if made.dense is None:
        return {}
    aligned = ", aligned to the pictures" * made.match.is_further_refined
    return {"dense": f"{made.dense.num_points:,} points{aligned}"}


def _moving(made: Run) -> str:
    """Return how many tracks are on moving objects, where that was looked for."""
    facts: dict[str, Any] | None = made.data["movers"]
    if not facts or not facts["num_tracks"]:
        return ""
    return f", {facts['num_tracks']:,} of them moving{', left out' * facts['excluded']}"


def _partial(made: Run) -> str | None:
    if made.match.damage is not None:
        return (
            f"the {len(made.match.frames)} frames before the damage were read, "
            "and only they are in the result"
        )
    if not made.model.accepted:
        return "tracks, database and report are complete; there is no model"
    if made.model.registered < made.model.total:
        return "tracks, database and report cover the whole video, the model a part of it"
    return None
