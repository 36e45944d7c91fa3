"""Motion fields chained into tracks: options and the thin face of the Rust crate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from mvmatch.batches import track_batches
from mvmatch.confidence import default_error_model
from mvmatch.filters import within_budget
from mvmatch.types import Tracks

if TYPE_CHECKING:
    from collections.abc import Iterable

    from mvmatch.types import MotionField

Carry = Literal["translate", "fuse"]
Follow = Literal["nearest", "all"]


@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """Rules of chaining. The defaults are the preset ``default``."""

    keep_zero: bool = True
    """Zero vectors are motion. The paper takes them for absent, since its reader cannot tell."""
    max_error: float | None = 0.16
    """px at rest; vectors whose expected (median) error is larger are not used; None: all are. A
    vector of 20 px may be off by twice as much, and so on: near points move fast, and carry the
    geometry. Measured: the share of points within 1 px of the truth rises on every sequence."""
    max_drift: float | None = 0.5
    """px at rest, likewise; a track ends where the errors of its steps, taken as independent, add
    up to more; None: tracks go on."""
    num_neighbors: int = 12
    """Nearest blocks with the same reference that a vector is compared and fused with; 1 to 32."""
    carry: Carry = "fuse"
    """What moves a point: the vector of the block that covers it (``translate``, the paper), or the
    mean of that vector and what the neighbours say at its centre, with the slope of the motion
    around it (``fuse``). Measured: ``fuse`` halves the error over one frame and takes a quarter
    to two fifths off it over ten."""
    follow: Follow = "all"
    """Which references of a compound block are followed: all, or the one nearest in display order
    (the past one of two equally near)."""
    epsilon: float | None = None
    """The cosine between successive steps is at least 1 - epsilon (paper, II-B); None: not tested.
    Off is None: even epsilon = 1 would end tracks at turns beyond 90 degrees. Measured: behind the
    error model the test finds nothing more."""
    tau: float = 1.0
    """px; steps shorter than this are not tested: quantised vectors have no exact direction."""
    cell: int | None = 8
    """px; side of the square cells that hold at most one track per frame, the longest. Blocks start
    a track at their centre; large ones that move as one (``fuse``) start one every two cells. None:
    every block starts one. Measured: 12 to 24 times less mapping, poses no worse."""
    extend: bool = True
    """Tracks also reach, in a second walk, into the frames that refer to theirs, through the blocks
    that lead to their points. Measured: 10 to 20 % more matches of the same accuracy in low-delay
    streams, 6 to 10 times as many in a pyramid of hidden frames."""
    min_length: int = 3
    """Observations; shorter tracks are dropped (paper, II-B)."""
    max_keypoints_per_image: int | None = None
    """No image has more matched keypoints; the most useful are kept, spread over the picture
    (:func:`mvmatch.filters.budget`). None: no cap."""
    fill: int | None = None
    """px; side of the cells of further tracks, which start at the middle of each cell that no track
    passes and a usable block covers. They are not matched: their points join the finished model
    (:func:`mvmatch.sfm.densify`). None: there are none."""
    fill_error: float | None = 0.5
    """px at rest; ``max_error`` of further tracks. Poses are known when they are triangulated, and
    tell what is wrong. Measured: these bounds halve the mean distance of the surface to
    the nearest point in fast footage (docs/decisions/0019-dense-points-look-at-the-pictures.md)."""
    fill_drift: float | None = 1.0
    """px at rest; their ``max_drift``."""
    max_gap: int | None = 10
    """Frames; matches of a track are exported for pairs up to this far apart; None: every pair on
    a track, as the paper does, quadratic in the length of the tracks."""
    window: int | None = 256
    """Coded frames that are chained at once; None: all. Bounds the memory. Tracks of longer videos
    go on from window to window; at each border they differ a little from those of one window."""

    def __post_init__(self) -> None:
        bounds = {
            "max_error": (self.max_error, 0.0),
            "max_drift": (self.max_drift, 0.0),
            "fill_error": (self.fill_error, 0.0),
            "fill_drift": (self.fill_drift, 0.0),
            "epsilon": (self.epsilon, 0.0),
            "tau": (self.tau, 0.0),
            "cell": (self.cell, 1),
            "fill": (self.fill, 1),
            "max_keypoints_per_image": (self.max_keypoints_per_image, 1),
            "min_length": (self.min_length, 1),
            "max_gap": (self.max_gap, 1),
            "window": (self.window, 1),
        }
        for name, (value, least) in bounds.items():
            if value is not None and not value >= least:
                message = f"{name} is {value}; it must be at least {least}"
                raise ValueError(message)
        if not 1 <= self.num_neighbors <= 32:
            message = f"num_neighbors is {self.num_neighbors}; it must be 1 to 32"
            raise ValueError(message)

    @classmethod
    def preset(cls, name: str) -> TrackOptions:
        """Return a named set of rules.

        ``default`` is what measured best. ``dense`` maps the same tracks and then adds many more
        points to the model. ``fast`` maps fewer tracks. ``paper`` keeps to the rules of
        Zouein et al. 2025 to the letter: block centres start tracks, no zero vectors, cosine test
        with epsilon 0.1 on every step, length of at least 3, every pair on a track, nothing
        thinned.

        Raises
        ------
        ValueError
            For another name.

        Examples
        --------
        >>> TrackOptions.preset("paper").keep_zero
        False
        """
        presets: dict[str, dict[str, Any]] = {
            "default": {},
            "dense": {"fill": 3},
            "fast": {"max_keypoints_per_image": 500},
            "paper": {
                "keep_zero": False,
                "max_error": None,
                "max_drift": None,
                "carry": "translate",
                "follow": "nearest",
                "epsilon": 0.1,
                "extend": False,
                "tau": 0.0,
                "cell": None,
                "max_gap": None,
                "window": None,
            },
        }
        if name not in presets:
            message = f"no preset {name!r}; there are {', '.join(presets)}"
            raise ValueError(message)
        return cls(**presets[name])


def build_tracks(fields: Iterable[MotionField], *, options: TrackOptions | None = None) -> Tracks:
    """Chain motion fields into tracks.

    Frames are visited in reverse decode order, so that every point that can reach a frame is there
    when its turn comes, whatever the prediction structure. A point is carried through the block
    that covers it and never snapped to the block's centre; where it arrives it becomes an
    observation of the reference frame. It ends on intra blocks, outside the picture, and where the
    direction turns. A second walk, in decode order, extends tracks into frames that refer to
    theirs. Hidden frames take part under the display index of the picture they stand for.

    Videos of more than ``options.window`` coded frames are chained window by window: tracks that
    reach a border are carried on first, in decode order.

    Parameters
    ----------
    fields : iterable of MotionField
        In decode order, frames without vectors included. Read once; per row 24 bytes are kept
        until its window is chained (40 with ``carry="fuse"``).
    options : TrackOptions, optional
        Rules; by default the preset ``default``.

    Returns
    -------
    Tracks
        Deterministic; tracks ordered by the window they end in, then by where they start, last
        decoded frame first; those of ``options.fill`` come last.

    Raises
    ------
    ValueError
        If a field has arrays of the wrong shape, or decode indices do not rise.

    References
    ----------
    Zouein et al. 2025, section II-B.
    """
    return Tracks.concatenate(*chain_fields(fields, options=options))


def chain_fields(
    fields: Iterable[MotionField], *, options: TrackOptions | None = None
) -> tuple[Tracks, Tracks]:
    """Chain as :func:`build_tracks` does, and keep the tracks of ``options.fill`` apart.

    Returns
    -------
    tracks, further : Tracks
        What is matched and mapped, the same for any ``fill``; and what only makes the model denser.
    """
    from mvmatch._core import TrackLinker

    options = options or TrackOptions()
    fill = None
    if options.fill is not None:
        fill = options.fill, options.fill_error, options.fill_drift
    linker = TrackLinker(
        keep_zero=options.keep_zero,
        error_weights=default_error_model().weights,
        max_error=options.max_error,
        max_drift=options.max_drift,
        num_neighbors=options.num_neighbors,
        carry=options.carry,
        follow=options.follow,
        epsilon=options.epsilon,
        tau=options.tau,
        cell=options.cell,
        extend=options.extend,
        min_length=options.min_length,
        fill=fill,
        window=options.window,
    )
    decoded, size = -1, (1, 1)
    with track_batches() as own, track_batches() as others:
        for field in fields:
            if field.decode_index <= decoded:
                message = f"fields must be in decode order: {field.decode_index} follows {decoded}"
                raise ValueError(message)
            decoded = field.decode_index
            size = max(size[0], field.width), max(size[1], field.height)
            linker.push(field)
            for batches, arrays in zip((own, others), linker.take(), strict=True):
                batches.add(*arrays)
        for batches, arrays in zip((own, others), linker.finish(), strict=True):
            batches.add(*arrays)
        tracks, further = own.tracks(), others.tracks()
    if options.max_keypoints_per_image is None:
        return tracks, further
    kept = within_budget(tracks, max_keypoints=options.max_keypoints_per_image, size=size)
    if options.fill is not None:
        further = Tracks.concatenate(tracks.select(~kept), further)
    return tracks.select(kept), further
