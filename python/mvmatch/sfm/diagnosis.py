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
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from mvmatch.sfm.adjust import fit_squares, focal_change
from mvmatch.sfm.evidence import read_evidence
from mvmatch.sfm.mapping import MIN_STRETCH

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    import pycolmap
    from numpy.typing import NDArray

    from mvmatch.errors import MvmatchError
    from mvmatch.footage import Footage
    from mvmatch.sfm.evidence import Evidence, PairEvidence
    from mvmatch.sfm.mapping import ReconstructionResult
    from mvmatch.types import Tracks

Status = Literal["complete", "partial", "failed"]
Code = Literal[
    "damage",
    "scene-cut",
    "key-frame",
    "few-tracks",
    "static",
    "rotation",
    "planar",
    "focal-length",
    "repeats",
    "unregistered",
    "unexplained",
]
Ranges = tuple[tuple[int, int], ...]
"""First and last picture of each part."""

MIN_BRIDGE = 20
"""Tracks that must lead from one picture to the next (`AcceptanceOptions.min_joint`)."""

STILL = 0.25
"""px; median motion of the tracks between two pictures in which nothing moves."""

MAX_DRIFT = 1.0
"""px; median motion of the tracks through a whole part in which nothing moves."""

MIN_PART = 5
"""Pictures; what stands still or turns for a shorter time is bridged by matches across."""

FLAT_SHARE = 0.95
"""Share of a pair's matches that one homography explains."""

MIN_FLAT_MOTION = 16.0
"""px; matches that move less fit a homography whatever the scene: its bound is 4 px."""

MAX_FOCAL_CHANGE = 0.05
"""Relative change of a given focal length (`MapperOptions.max_focal_change`)."""

MIN_FOCAL_ERROR = 0.02
"""px; see `MapperOptions.min_focal_error`."""

MAX_PRIOR_FACTOR = 3.0
"""Between a guessed focal length and the refined one; the field of view of nearly all lenses lies
closer to the guess."""

_MAX_PAIRS = 20_000

_NO_PARALLAX = frozenset({"static", "rotation", "planar"})
"""Where these were found, nothing is known of the focal length."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that stands in the way of a whole model."""

    code: Code
    frames: Ranges
    """Where: first and last picture (display index) of each part; empty: everywhere."""
    sentence: str
    """What is the matter."""
    advice: str
    """What to try."""


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """How much of a model there is, and what stands in the way of the rest."""

    status: Status = "complete"
    """``complete``: all pictures of an undamaged video are registered in an accepted model;
    ``partial``: some are; ``failed``: no model was accepted."""
    findings: tuple[Finding, ...] = ()
    """Gravest first; none of a complete model."""


def status_of(result: ReconstructionResult, damage: MvmatchError | None = None) -> Status:
    """Return how much of a model there is."""
    if not result.accepted:
        return "failed"
    return "complete" if damage is None and result.registered == result.total else "partial"


def diagnose(
    result: ReconstructionResult,
    database: Path,
    *,
    tracks: Tracks,
    footage: Footage,
    key_frames: Iterable[int] = (),
    damage: MvmatchError | None = None,
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
            *_broken(tracks, footage, frozenset(key_frames), result.total),
            *_motionless(tracks, result.total),
            *_degenerate(evidence, result.total),
        ]
        found = parts
        if not any(part.code in _NO_PARALLAX for part in parts):
            found += _focal_length(result, evidence)
        found += [*_repeats(footage), *_unregistered(result)]
    if damage is not None:
        found.insert(0, _damage(damage, result.total))
    return Diagnosis(status=status, findings=tuple(found) or (_unexplained(result),))


def bridging_tracks(tracks: Tracks, num_frames: int) -> NDArray[np.int64]:
    """(F,) number of tracks seen both before each picture and in it or later; 0 for the first."""
    change = np.zeros(num_frames + 1, np.int64)
    if len(tracks):
        np.add.at(change, tracks.frame[tracks.offsets[:-1]] + 1, 1)
        np.add.at(change, tracks.frame[tracks.offsets[1:] - 1] + 1, -1)
    return np.cumsum(change)[:num_frames]


def _damage(damage: MvmatchError, num_frames: int) -> Finding:
    return Finding(
        code="damage",
        frames=((num_frames, num_frames),),
        sentence=f"The stream broke off before picture {num_frames}: {damage}",
        advice="Copy or download the video again; --errors resume reads on after the damage.",
    )


def _broken(
    tracks: Tracks, footage: Footage, key_frames: frozenset[int], num_frames: int
) -> list[Finding]:
    """Find where too few tracks lead on, and say why if that is known."""
    bridge = bridging_tracks(tracks, num_frames)
    found: list[Finding] = []
    if footage.cuts:
        shots = ", ".join(str(cut) for cut in footage.cuts)
        found.append(
            Finding(
                code="scene-cut",
                frames=tuple((cut, cut) for cut in footage.cuts),
                sentence=f"The scene changes before picture {shots}: a model holds one shot.",
                advice="Give each shot as a video, or folder of pictures, of its own.",
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
                sentence=f"Tracks end at the key frames {_listed(keys)} of the video.",
                advice="Encode it anew for matching: --re-encode.",
            )
        )
    for first, last in _runs(weak & ~at_key):
        fewest = int(bridge[first : last + 1].min())
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
    return found


def _motionless(tracks: Tracks, num_frames: int) -> list[Finding]:
    """Find parts in which the camera stands still."""
    step = np.full(num_frames, np.inf)
    for frame in range(1, num_frames):
        step[frame] = _median_motion(tracks, frame - 1, frame)
    parts: list[tuple[int, int]] = []
    for first, last in _runs(step < STILL):
        if last - first + 2 < MIN_PART:
            continue
        drift = _median_motion(tracks, first - 1, last)
        if not MAX_DRIFT < drift < np.inf:
            parts.append((first - 1, last))
    if not parts:
        return []
    return [
        Finding(
            code="static",
            frames=tuple(parts),
            sentence=f"The camera does not move in the pictures {_ranges(parts)}: "
            "without parallax there is no depth.",
            advice="Leave them out, or begin where the camera moves.",
        )
    ]


def _degenerate(evidence: Evidence, num_frames: int) -> list[Finding]:
    """Find parts in which the camera only turns, or sees one plane."""
    turns = _where(evidence, num_frames, _is_turn)
    planes = _where(evidence, num_frames, _is_plane)
    found: list[Finding] = []
    if turns:
        found.append(
            Finding(
                code="rotation",
                frames=tuple(turns),
                sentence=f"The camera only turns in the pictures {_ranges(turns)}: "
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
                sentence=f"One plane explains the matches in the pictures {_ranges(planes)}: "
                "motion and camera are ambiguous there.",
                advice="Let things of different depth into the picture, and give the true camera "
                "with --camera.",
            )
        )
    return found


def _where(
    evidence: Evidence, num_frames: int, holds: Callable[[PairEvidence], bool]
) -> list[tuple[int, int]]:
    """Parts in which most of the pairs across each boundary have a property."""
    votes = np.zeros(num_frames + 1, np.int64)
    for pair in evidence.pairs:
        vote = 1 if holds(pair) else -1
        # Images are frames plus one: the pair reaches over the boundaries image0 to image1 - 1.
        votes[pair.image0] += vote
        votes[pair.image1] -= vote
    runs = _runs(np.cumsum(votes)[:num_frames] > 0)
    return [(first - 1, last) for first, last in runs if last - first + 2 >= MIN_PART]


def _is_turn(pair: PairEvidence) -> bool:
    flat = pair.homography_ratio > FLAT_SHARE
    return flat and pair.stretch < MIN_STRETCH and pair.displacement >= MAX_DRIFT


def _is_plane(pair: PairEvidence) -> bool:
    flat = pair.homography_ratio > FLAT_SHARE
    return flat and pair.stretch >= MIN_STRETCH and pair.displacement >= MIN_FLAT_MOTION


def _focal_length(result: ReconstructionResult, evidence: Evidence) -> list[Finding]:
    """Compare the focal length of the database with the one that the model wants."""
    import pycolmap

    model = result.reconstruction
    if model is None or not model.cameras or not model.num_points3D():
        return []
    wanted = pycolmap.Reconstruction(model)
    if evidence.has_prior_focal_length:
        cost = fit_squares(wanted, "nothing")
        saved = max(0.0, cost - fit_squares(wanted, "focal length"))
        error = math.sqrt(2.0 * saved / max(1, model.compute_num_observations()))
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


def _repeats(footage: Footage) -> list[Finding]:
    if not footage.repeats:
        return []
    return [
        Finding(
            code="repeats",
            frames=tuple((frame, frame) for frame in footage.repeats),
            sentence=f"The pictures {_listed(footage.repeats)} show the one before again.",
            advice="Leave them out: ffmpeg -i VIDEO -vf mpdecimate -fps_mode vfr OUT.",
        )
    ]


def _unregistered(result: ReconstructionResult) -> list[Finding]:
    model = result.reconstruction
    if model is None:
        return []
    missing = np.ones(result.total + 1, np.bool_)
    missing[[image - 1 for image in model.reg_image_ids()]] = False
    missing[-1] = False
    runs = _runs(missing)
    if not runs:
        return []
    return [
        Finding(
            code="unregistered",
            frames=tuple(runs),
            sentence=f"The pictures {_ranges(runs)} are not in the model.",
            advice="Reconstruct them as a video, or folder of pictures, of their own.",
        )
    ]


def _unexplained(result: ReconstructionResult) -> Finding:
    return Finding(
        code="unexplained",
        frames=(),
        sentence=f"No model holds: {'; '.join(result.reasons)}.",
        advice="Give the true camera with --camera, or footage in which the camera moves sideways.",
    )


def _median_motion(tracks: Tracks, frame0: int, frame1: int) -> float:
    """Median motion in px between two frames; infinite without matches."""
    pair = tracks.between(frame0, frame1)
    if not len(pair):
        return math.inf
    return float(np.median(np.linalg.norm(pair.xy1 - pair.xy0, axis=1)))


def _focal(cameras: Mapping[int, pycolmap.Camera]) -> float:
    return max(camera.mean_focal_length() for camera in cameras.values())


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False]))))
    return [(first, end - 1) for first, end in edges.reshape(-1, 2).tolist()]


def _ranges(parts: Sequence[tuple[int, int]]) -> str:
    """Name the first five parts."""
    named = [str(a) if a == b else f"{a} to {b}" for a, b in parts[:5]]
    return ", ".join(named) + (" …" if parts[5:] else "")


def _listed(frames: Sequence[int]) -> str:
    return _ranges([(frame, frame) for frame in frames])
