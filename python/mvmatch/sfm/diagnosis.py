"""Why there is no model, or only a part of one: where the footage broke, and what to try.

A mapper says which images it has not registered, not why. The tracks, the footage and the relative
motion of image pairs know more: where tracks end, where nothing moves, where the camera only turns.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false

from __future__ import annotations

import math
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.rows import count_entering, count_keypoints
from mvmatch.sfm.adjust import fit_focal_length, focal_change
from mvmatch.sfm.breaks import (
    MIN_PART,
    is_plane,
    is_turn,
    named_frames,
    named_parts,
    parts_at_rest,
    parts_where,
    runs,
)
from mvmatch.sfm.evidence import read_evidence
from mvmatch.sfm.findings import Diagnosis, Finding, status_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.errors import MvmatchError
    from mvmatch.footage import Footage
    from mvmatch.sfm.evidence import Evidence
    from mvmatch.sfm.result import ReconstructionResult
    from mvmatch.sources import Skipped
    from mvmatch.types import Tracks

MIN_BRIDGE = 20
"""Tracks that must lead from one picture to the next (`AcceptanceOptions.min_joint`)."""

MAX_FOCAL_CHANGE = 0.05
"""Relative change of a given focal length (`MapperOptions.max_focal_change`)."""

MIN_FOCAL_ERROR = 0.02
"""px; see `MapperOptions.min_focal_error`."""

MAX_PRIOR_FACTOR = 3.0
"""Between a guessed focal length and the refined one; the field of view of nearly all lenses lies
closer to the guess."""

_MAX_PAIRS = 20_000

_COPY_AGAIN = "Copy or download the video again."

_NO_PARALLAX = frozenset({"static", "rotation", "planar"})
"""Where these were found, nothing is known of the focal length."""


def diagnose(
    result: ReconstructionResult,
    database: Path,
    *,
    tracks: Tracks,
    footage: Footage,
    key_frames: Iterable[int] = (),
    damage: MvmatchError | None = None,
    skipped: Sequence[Skipped] = (),
) -> Diagnosis:
    """Find out what stands in the way of a whole model.

    Parameters
    ----------
    result : ReconstructionResult
        Of :func:`mvmatch.sfm.reconstruct`.
    database : Path
        The COLMAP database it was made from; it is not changed.
    tracks : Tracks
        Those in the database, px.
    footage : Footage
        Cuts and repeated pictures.
    key_frames : iterable of int
        Pictures at which the encoder cut all tracks.
    damage : MvmatchError, optional
        Why the stream broke off after the last picture.
    skipped : sequence of Skipped, optional
        What was left out of a stream that was read on after damage.

    Returns
    -------
    Diagnosis
        Without findings when the model is complete; else with at least one.

    Raises
    ------
    FileNotFoundError
        There is no such database.
    """
    status = status_of(result, damage)
    if status == "complete":
        return Diagnosis()
    with tempfile.TemporaryDirectory(prefix="mvmatch-sfm-") as folder:
        copy = Path(folder) / "database.db"
        shutil.copyfile(database, copy)  # even reading changes a database
        evidence = read_evidence(copy, max_pairs=_MAX_PAIRS)
    if result.accepted and result.registered == result.total:
        found: list[Finding] = []
    else:
        parts = [
            *_broken(tracks, footage, frozenset(key_frames), result.total, bool(skipped)),
            *_motionless(tracks, footage, result.total),
            *_degenerate(evidence, result.total),
        ]
        found = parts
        if not any(part.code in _NO_PARALLAX for part in parts):
            found += _focal_length(result, evidence)
        found += [*_joints(result, found), *_repeats(footage)]
        found += [*_elsewhere(result), *_unregistered(result)]
    if damage is not None:
        found.insert(0, _damage(damage, result.total))
    return Diagnosis(status=status, findings=tuple(found) or (_unexplained(result),))


def _damage(damage: MvmatchError, num_frames: int) -> Finding:
    return Finding(
        code="damage",
        frames=((num_frames, num_frames),),
        sentence=f"The stream broke off before picture {num_frames}: {damage}",
        advice=f"{_COPY_AGAIN[:-1]}; --errors resume reads on after the damage.",
    )


def _broken(
    tracks: Tracks,
    footage: Footage,
    key_frames: frozenset[int],
    num_frames: int,
    is_damaged: bool,  # noqa: FBT001
) -> list[Finding]:
    """Find where too few tracks lead on, and say why if that is known."""
    bridge = count_entering(tracks, num_frames)
    found: list[Finding] = []
    if footage.cuts:
        shots = ", ".join(str(cut) for cut in footage.cuts)
        found.append(
            Finding(
                code="scene-cut",
                frames=tuple((cut, cut) for cut in footage.cuts),
                sentence=f"The scene changes before picture {shots}: each model holds one shot.",
                advice="Give a shot that has none as a video, or folder of pictures, of its own.",
            )
        )
    weak = bridge < MIN_BRIDGE
    weak[[0, *(cut for cut in footage.cuts if cut < num_frames)]] = False
    at_key = np.isin(np.arange(num_frames), list(key_frames)) & weak
    if at_key.any():
        keys = np.flatnonzero(at_key).tolist()
        found.append(
            Finding(
                code="key-frame",
                frames=tuple((key, key) for key in keys),
                sentence=f"Tracks end at the key frames {named_frames(keys)} of the video.",
                advice="Encode it anew for matching: --re-encode.",
            )
        )
    for first, last in runs(weak & ~at_key):
        fewest = int(bridge[first : last + 1].min())
        if is_damaged and not fewest:
            found.append(_lost(first, last))
            continue
        found.append(
            Finding(
                code="few-tracks",
                frames=((first - 1, last),),
                sentence=f"Only {fewest} tracks lead from picture {first - 1} to {last}; "
                f"{MIN_BRIDGE} are the least that holds a model together.",
                advice="Blur, darkness, fast motion or bare walls leave few: give more frames per "
                "second or a better quality (--set encode.quality=20), or leave the part out.",
            )
        )
    weak |= at_key | np.isin(np.arange(num_frames), footage.cuts)
    return found + _thin(tracks, weak | np.roll(weak, -1))


def _lost(first: int, last: int) -> Finding:
    part = named_parts([(first, last)])
    return Finding(
        code="damage",
        frames=((first, last),),
        sentence=f"The stream is damaged: no track goes on into the pictures {part}.",
        advice=_COPY_AGAIN,
    )


def _thin(tracks: Tracks, known: NDArray[np.bool_]) -> list[Finding]:
    """Find pictures with few points of the tracks that lead past them."""
    points = count_keypoints(tracks, len(known))
    pictures = np.flatnonzero((points < MIN_BRIDGE) & ~known).tolist()
    if not pictures:
        return []
    return [
        Finding(
            code="few-tracks",
            frames=tuple((picture, picture) for picture in pictures),
            sentence=f"Few tracks have points in the pictures {named_frames(pictures)}, "
            f"{int(points[pictures].min())} at least; {MIN_BRIDGE} are needed.",
            advice="The encoder spent little on them: encode anew for matching (--re-encode).",
        )
    ]


def _motionless(tracks: Tracks, footage: Footage, num_frames: int) -> list[Finding]:
    """Find parts in which the camera stands still."""
    whole = [(0, num_frames - 1)]
    parts = whole if footage.stands_still else parts_at_rest(tracks, num_frames)
    if not parts:
        return []
    return [
        Finding(
            code="static",
            frames=tuple(parts),
            sentence=f"The camera does not move in the pictures {named_parts(parts)}: "
            "without parallax there is no depth.",
            advice="The camera has to move through the scene."
            if parts == whole
            else "Leave them out, or begin where the camera moves.",
        )
    ]


def _degenerate(evidence: Evidence, num_frames: int) -> list[Finding]:
    """Find parts in which the camera only turns, or sees one plane."""
    turns = parts_where(evidence, num_frames, is_turn)
    planes = parts_where(evidence, num_frames, is_plane)
    found: list[Finding] = []
    if turns:
        found.append(
            Finding(
                code="rotation",
                frames=tuple(turns),
                sentence=f"The camera only turns in the pictures {named_parts(turns)}: "
                "a rotation explains the matches.",
                advice="Give footage in which the camera moves sideways while it turns, or leave "
                "the part out.",
            )
        )
    if planes:
        found.append(
            Finding(
                code="planar",
                frames=tuple(planes),
                sentence=f"One plane explains the matches in the pictures {named_parts(planes)}: "
                "motion and camera are ambiguous there.",
                advice="Let things of different depth into the picture, and give the true camera "
                "with --camera.",
            )
        )
    return found


def _focal_length(result: ReconstructionResult, evidence: Evidence) -> list[Finding]:
    """Compare the focal length of the database with the one that the model wants."""
    import pycolmap

    model = result.reconstruction
    if model is None or not model.cameras or not model.num_points3D():
        return []
    wanted = pycolmap.Reconstruction(model)
    if evidence.has_prior_focal_length:
        error = fit_focal_length(wanted)
        if error < MIN_FOCAL_ERROR or focal_change(model, wanted) <= MAX_FOCAL_CHANGE:
            return []
    given, refined = (_focal(cameras) for cameras in (evidence.cameras, dict(wanted.cameras)))
    factor = max(refined / given, given / refined) if refined > 0 else math.inf
    if not evidence.has_prior_focal_length and factor <= MAX_PRIOR_FACTOR:
        return []
    told = "given" if evidence.has_prior_focal_length else "guessed"
    return [
        Finding(
            code="focal-length",
            frames=(),
            sentence=f"The focal length {told}, {given:.0f} px, does not fit: adjusted to the "
            f"matches it is {refined:.0f} px.",
            advice="Give the true camera with --camera (of pictures of this size), or none: then "
            "it is estimated.",
        )
    ]


def _joints(result: ReconstructionResult, known: Sequence[Finding]) -> list[Finding]:
    """Name the places that no model holds across, where nothing else is known of them."""
    named = [part for finding in known for part in finding.frames]
    return [
        Finding(
            code="joint",
            frames=((joint.before - 1, joint.after - 1),),
            sentence=f"No model holds across the pictures {joint.before - 1} to "
            f"{joint.after - 1}: {joint.reason}.",
            advice="What the camera sees there gives wrong matches: leave it out, or give more "
            "frames per second.",
        )
        for joint in result.joints
        if not any(a <= joint.after - 1 and b >= joint.before - 1 for a, b in named)
    ]


def _repeats(footage: Footage) -> list[Finding]:
    if not footage.repeats:
        return []
    return [
        Finding(
            code="repeats",
            frames=tuple((frame, frame) for frame in footage.repeats),
            sentence=f"The pictures {named_frames(footage.repeats)} show the one before again.",
            advice="Leave them out: ffmpeg -i VIDEO -vf mpdecimate -fps_mode vfr OUT.",
        )
    ]


def _elsewhere(result: ReconstructionResult) -> list[Finding]:
    """Name the pictures that the models of other parts hold."""
    import pycolmap

    return [
        Finding(
            code="other-model",
            frames=tuple(parts),
            sentence=f"The pictures {named_parts(parts)} are in a model of their own, "
            f"number {path.name}.",
            advice="Neither place nor scale of the models has to do with each other.",
        )
        for path in result.further
        if (parts := runs(_registered(pycolmap.Reconstruction(path), result.total)))
    ]


def _unregistered(result: ReconstructionResult) -> list[Finding]:
    """Name the pictures that no model holds, where there is one."""
    import pycolmap

    if result.reconstruction is None:
        return []
    models = (result.reconstruction, *map(pycolmap.Reconstruction, result.further))
    held = np.logical_or.reduce([_registered(model, result.total) for model in models])
    parts = runs(np.append(~held[:-1], False))
    if not parts:
        return []
    return [
        Finding(
            code="unregistered",
            frames=tuple(parts),
            sentence=f"The pictures {named_parts(parts)} are in no model."
            if result.further
            else f"The pictures {named_parts(parts)} are not in the model.",
            advice="Reconstruct them as a video, or folder of pictures, of their own."
            if max(last - first for first, last in parts) >= MIN_PART
            else "Too few good matches reach them: a better quality may give more "
            "(--re-encode --set encode.quality=20).",
        )
    ]


def _registered(model: pycolmap.Reconstruction, total: int) -> NDArray[np.bool_]:
    """(F + 1,) pictures that a model holds; the last is none."""
    held = np.zeros(total + 1, np.bool_)
    held[[image - 1 for image in model.reg_image_ids()]] = True
    return held


def _unexplained(result: ReconstructionResult) -> Finding:
    return Finding(
        code="unexplained",
        frames=(),
        sentence=f"No model holds: {'; '.join(result.reasons)}.",
        advice="Give the true camera with --camera, or footage in which the camera moves sideways.",
    )


def _focal(cameras: Mapping[int, pycolmap.Camera]) -> float:
    return max(camera.mean_focal_length() for camera in cameras.values())
