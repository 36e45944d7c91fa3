"""The verbs from tracks to a model."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from mvmatch.cli.console import Outcome, Ticker
from mvmatch.cli.settings import (
    ExistingFile,
    Json,
    Settings,
)

if TYPE_CHECKING:
    from mvmatch.config import RunOptions
    from mvmatch.sfm import ReconstructionResult
    from mvmatch.types import TwoViewScore

Camera = Annotated[
    str | None,
    Parameter(
        help="COLMAP camera (PINHOLE,fx,fy,cx,cy) or camera file; calibration of KITTI, OpenCV, "
        "ROS or Kalibr; transforms.json of nerfstudio; a picture or video that recorded its focal "
        "length; or focal length in px. Without it, 1.2 times the longer side is refined.",
    ),
]
Mapper = Annotated[
    Literal["incremental", "global"] | None, Parameter(help="COLMAP's mapper to use.")
]

MODEL_ADVICE = "Give the true camera with --camera, or footage in which the camera moves sideways"
"""What helps when no model holds."""


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
            "pairs": f"{summary.num_verified_pairs} of {summary.num_pairs} verified "
            f"({summary.num_estimated_pairs} estimated), "
            f"{summary.num_inliers:,} of {summary.num_matches:,} matches",
            "camera": choice.source,
        },
        next=f"mvmatch reconstruct {database} sfm",
        data={**counts, "camera": choice.source},
        warnings=list(choice.warnings),
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
        data={"scores": scores},
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

    options = with_mapper((settings or Settings()).options(), mapper)
    with Ticker() as tell:
        tell("map", 0, None)
        model = run_mapper(database, out, options=options.mapper)
    failure = None
    if not model.accepted:
        failure = DataError(f"no model holds: {'; '.join(model.reasons)}. {MODEL_ADVICE}")
    return Outcome(
        made=model_paths(model),
        figures=model_figures(model),
        next=look_at(model.path, database, Path()) if model.path is not None else None,
        data={"model": {k: v for k, v in vars_of(model).items() if k != "reconstruction"}},
        failure=failure,
    )


def vars_of(value: Any) -> dict[str, Any]:
    """Return the fields of a dataclass without descending into them."""
    return {item.name: getattr(value, item.name) for item in dataclasses.fields(value)}


def look_at(model: Path, database: Path, images: Path) -> str:
    """Return the command that shows a model."""
    return f"colmap gui --import_path {model} --database_path {database} --image_path {images}"


def with_mapper(options: RunOptions, mapper: Literal["incremental", "global"] | None) -> RunOptions:
    """Return the options with another mapper, if one was named."""
    if mapper is None:
        return options
    return dataclasses.replace(options, mapper=dataclasses.replace(options.mapper, mapper=mapper))


def model_paths(model: ReconstructionResult) -> list[Path]:
    """Return the folders of the written models."""
    return [] if model.path is None else [model.path, *model.further]


def model_figures(model: Any) -> dict[str, str]:
    """Say how large and how good a model is."""
    text = f"{model.registered}/{model.total} images registered, {model.num_points:,} points"
    if model.num_keyframes < model.total:
        text += f", {model.num_keyframes} key frames mapped"
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
