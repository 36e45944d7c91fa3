"""The verbs from tracks to a model, and the one that does everything."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from mvmatch.cli.console import Outcome, Ticker
from mvmatch.cli.settings import (
    ExistingFile,
    ExistingPath,
    Json,
    Output,
    Settings,
    UsageError,
    with_encoder,
)
from mvmatch.encode import EncoderName

if TYPE_CHECKING:
    from mvmatch.config import RunOptions
    from mvmatch.pipeline import Run
    from mvmatch.types import TwoViewScore

Camera = Annotated[
    str | None,
    Parameter(
        help="COLMAP camera (PINHOLE,fx,fy,cx,cy), COLMAP camera file, KITTI calib file, or focal "
        "length in px. Without it a prior of 1.2 times the longer side is refined.",
    ),
]
Mapper = Annotated[
    Literal["incremental", "global"] | None, Parameter(help="COLMAP's mapper to use.")
]


def export(
    tracks: ExistingFile,
    database: Path,
    /,
    *,
    camera: Camera = None,
    format: Literal["colmap", "hloc"] = "colmap",  # noqa: A002
    settings: Settings | None = None,
    json: Json = False,
) -> Outcome:
    """Write tracks as a COLMAP database with verified matches, or as hloc files.

    Parameters
    ----------
    tracks
        What `mvmatch track` wrote.
    database
        The database to write (for hloc: a folder).
    format
        colmap: database.db; hloc: features.h5 and matches.h5.
    """
    from mvmatch.camera import parse_camera
    from mvmatch.store import read_tracks

    options = (settings or Settings()).options()
    table = read_tracks(tracks)
    if format == "hloc":
        from mvmatch.export.hloc import write_hloc

        write_hloc(table.tracks, database, image_names=table.image_names)
        return Outcome(made=[database], figures={"images": str(len(table.image_names))})

    from mvmatch.export.colmap import write_database

    choice = parse_camera(camera, table.info.width, table.info.height)
    with Ticker() as tell:
        tell("verify", 0, None)
        summary = write_database(
            table.tracks,
            database,
            camera=choice.camera,
            image_names=table.image_names,
            verification=options.verification,
            max_gap=options.track.max_gap,
        )
    counts = dataclasses.asdict(dataclasses.replace(summary, scores=()))
    return Outcome(
        made=[database],
        figures={
            "images": f"{summary.num_images}, {summary.num_keypoints:,} keypoints",
            "pairs": f"{summary.num_verified_pairs} of {summary.num_pairs} verified, "
            f"{summary.num_inliers:,} of {summary.num_matches:,} matches",
            "camera": choice.source,
        },
        next=f"mvmatch reconstruct {database} sfm",
        data={**counts, "camera": choice.source},
    )


def score(database: ExistingFile, /, *, json: Json = False) -> Outcome:
    """Fit every image pair of a COLMAP database and say how well its matches agree.

    Parameters
    ----------
    database
        A COLMAP database with matches, made by mvmatch or by any other front end.
    """
    from mvmatch.export.scores import score_database

    with Ticker() as tell:
        tell("score", 0, None)
        scores = score_database(database)
    return Outcome(
        table=_gap_table(scores),
        figures={"pairs": f"{len(scores)}, {sum(s.model is not None for s in scores)} fitted"},
        next=f"mvmatch reconstruct {database} sfm",
        data={"scores": [_finite(dataclasses.asdict(score)) for score in scores]},
    )


def reconstruct(
    database: ExistingFile,
    out: Path,
    /,
    *,
    mapper: Mapper = None,
    settings: Settings | None = None,
    json: Json = False,
) -> Outcome:
    """Map a COLMAP database to a sparse model that holds, or say why there is none.

    Parameters
    ----------
    database
        A COLMAP database with two-view geometries.
    out
        Folder of the model.
    """
    from mvmatch.errors import DataError
    from mvmatch.sfm import reconstruct as run_mapper

    options = _with_mapper((settings or Settings()).options(), mapper)
    with Ticker() as tell:
        tell("map", 0, None)
        model = run_mapper(database, out, options=options.mapper)
    failure = None
    if not model.accepted:
        failure = DataError(f"no model holds: {'; '.join(model.reasons)}. {_MODEL_ADVICE}")
    return Outcome(
        made=[out] if model.accepted else [],
        figures=_model_figures(model),
        next=f"colmap gui --database_path {database} --import_path {out}",
        data={"model": {k: v for k, v in vars_of(model).items() if k != "reconstruction"}},
        failure=failure,
    )


def run(
    source: ExistingPath | None = None,
    /,
    *,
    out: Output = Path("out"),
    camera: Camera = None,
    encoder: EncoderName | None = None,
    mapper: Mapper = None,
    re_encode: Annotated[bool, Parameter(negative="")] = False,
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
    print_config
        Only print the effective options as TOML.
    """
    options = with_encoder((settings or Settings()).options(), encoder)
    options = _with_mapper(options, mapper)
    if print_config:
        from mvmatch.config import to_toml

        return Outcome(table=to_toml(options), data={"options": dataclasses.asdict(options)})
    if source is None:
        raise UsageError("run needs a video or a folder of frames")
    from mvmatch.pipeline import reconstruct_video

    with Ticker() as tell:
        made = reconstruct_video(
            source, out, camera=camera, options=options, reencode=re_encode, progress=tell
        )
    return run_outcome(made)


def run_outcome(made: Run) -> Outcome:
    """Return what a whole run says at its end."""
    from mvmatch import outputs
    from mvmatch.errors import DataError

    failure: Exception | None = made.match.damage
    model = made.out / outputs.MODEL / "0"
    if not made.model.accepted:
        reasons = "; ".join(made.model.reasons)
        failure = DataError(f"no model holds: {reasons}. {_MODEL_ADVICE}")
    stages: list[dict[str, Any]] = made.data["stages"]
    cost = ", ".join(f"{stage['name']} {stage['wall_s']:.1f} s" for stage in stages)
    cpu = sum(stage["cpu_s"] for stage in stages)
    warnings: list[str] = made.data["warnings"]
    if made.match.damage is not None:
        warnings = [text for text in warnings if not text.startswith("The stream broke off")]
    return Outcome(
        made=[
            made.out / name
            for name in (f"{outputs.MODEL}/0", outputs.DATABASE, outputs.PAGE)
            if (made.out / name).exists()
        ],
        figures={
            "video": f"{made.match.num_frames} pictures of {made.match.info.width}x"
            f"{made.match.info.height} px; camera: {made.camera.source}",
            "tracks": f"{len(made.match.tracks):,}; {made.database.num_inliers:,} matches in "
            f"{made.database.num_verified_pairs} image pairs",
            **_model_figures(made.model),
            "cost": f"{cost}; {cpu:.1f} CPU s",
        },
        next=(
            f"colmap gui --import_path {model} --database_path {made.out / outputs.DATABASE}"
            if made.model.accepted
            else f"open {made.out / outputs.PAGE}"
        ),
        data={key: value for key, value in made.data.items() if not key.startswith("adjacency")},
        warnings=warnings,
        failure=failure,
        partial=_partial(made),
    )


def _partial(made: Run) -> str | None:
    if made.match.damage is not None:
        return (
            f"the {len(made.match.frames)} frames before the damage were read, "
            "and only they are in the result"
        )
    if not made.model.accepted:
        return "tracks, database and report are complete; there is no model"
    return None


_MODEL_ADVICE = "Give the true camera with --camera, or footage in which the camera moves sideways"


def vars_of(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass without descending into them."""
    return {item.name: getattr(value, item.name) for item in dataclasses.fields(value)}


def _with_mapper(
    options: RunOptions, mapper: Literal["incremental", "global"] | None
) -> RunOptions:
    if mapper is None:
        return options
    return dataclasses.replace(options, mapper=dataclasses.replace(options.mapper, mapper=mapper))


def _model_figures(model: Any) -> dict[str, str]:
    text = f"{model.registered}/{model.total} images registered, {model.num_points:,} points"
    if model.num_points:
        text += (
            f", {model.mean_reprojection_error:.2f} px reprojection error, "
            f"{model.mean_track_length:.1f} images per point"
        )
    return {"model" if model.accepted else "rejected": text}


def _gap_table(scores: list[TwoViewScore]) -> str | None:
    """Medians per frame distance."""
    import numpy as np

    gaps: dict[int, list[TwoViewScore]] = {}
    for item in scores:
        gaps.setdefault(abs(item.frame1 - item.frame0), []).append(item)
    if not gaps:
        return None
    lines = ["distance  pairs  matches  inliers  Sampson px"]
    for gap, group in sorted(gaps.items()):
        matches = np.median([item.num_correspondences for item in group])
        inliers = np.median([item.inlier_ratio for item in group])
        fitted = [item.median_sampson_px for item in group if item.model is not None]
        sampson = f"{np.median(fitted):.3f}" if fitted else "-"
        lines.append(f"{gap:>8}  {len(group):>5}  {matches:>7.0f}  {inliers:>7.3f}  {sampson:>10}")
    return "\n".join(lines)


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """JSON has no NaN: what could not be measured is null."""
    return {key: None if value != value else value for key, value in values.items()}  # noqa: PLR0124
