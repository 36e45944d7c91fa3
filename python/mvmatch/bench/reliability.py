"""Is the confidence in a vector what it says? Vectors against the truth.

Of all vectors with a confidence of 90 % of being within 1 px of the truth, 90 % should be. How far
from that a method is, is its expected calibration error (Guo et al. 2017, On calibration of modern
neural networks, section 2).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mvmatch.bench.datasets import Half, Sequence, find_sequences, half_of
from mvmatch.bench.front_ends import ENCODERS, encoded_stream
from mvmatch.bench.run import open_sequence, prepare_clip
from mvmatch.confidence import default_error_model, expected_error
from mvmatch.errors import DataError
from mvmatch.filters import fuse_neighbors
from mvmatch.geometry.point_error import point_error
from mvmatch.sources import open_video

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    from mvmatch.types import MotionField

NUM_BINS = 10
"""Of equal width in confidence."""
RIGHT = 1.0
"""px; a vector this near to the truth is right."""
GROSS = 2.0
"""px; a vector farther from the truth is grossly wrong."""


@dataclass(frozen=True, kw_only=True)
class Bin:
    """Vectors of similar confidence."""

    confidence: float
    """Their mean."""
    hits: float
    """Share of them that is right."""
    count: int


@dataclass(frozen=True, kw_only=True)
class Reliability:
    """How far the confidence in vectors can be relied on."""

    bins: tuple[Bin, ...]
    """Those that hold vectors, confidence rising."""
    calibration_error: float
    """Mean distance of confidence and hits over the bins, weighted by their vectors."""
    gross: float
    """Share of vectors more than ``GROSS`` px off; a hidden target is."""
    gross_confident: float
    """The same of the more confident half."""

    @property
    def count(self) -> int:
        """Number of vectors."""
        return sum(each.count for each in self.bins)

    @property
    def confidence(self) -> float:
        """Mean confidence: the expected share of right vectors."""
        return sum(each.confidence * each.count for each in self.bins) / self.count

    @property
    def hits(self) -> float:
        """Share of vectors that are right."""
        return sum(each.hits * each.count for each in self.bins) / self.count


@dataclass(frozen=True, kw_only=True)
class Stream:
    """One encoded sequence."""

    sequence: str
    half: Half
    encoder: str
    """By the names of ``ENCODERS``."""
    quality: int | None
    """On the encoder's scale; None: its default."""


@dataclass(frozen=True, kw_only=True)
class ReliabilityOptions:
    """What is measured."""

    data: tuple[Path, ...]
    """Folders that are sequences or hold some."""
    out: Path
    sequences: tuple[str, ...] = ()
    """Names, with ``+composition`` for composed ones; empty: all with point truth as they are."""
    encoders: tuple[str, ...] = tuple(ENCODERS)
    qualities: tuple[int | None, ...] = (None,)
    """On the encoders' scale, None for their default."""
    max_frames: int | None = 60
    step: int = 3
    """Every how many frames vectors are compared."""


def rate(error: ArrayLike, confidence: ArrayLike, *, num_bins: int = NUM_BINS) -> Reliability:
    """Compare confidences with what came of them.

    Parameters
    ----------
    error : (N,) float
        px.
    confidence : (N,) float
        Probability of an error below ``RIGHT`` px.
    num_bins : int
        Bins of equal width.

    Raises
    ------
    ValueError
        There are no vectors.
    """
    errors, expected = np.asarray(error, np.float64), np.asarray(confidence, np.float64)
    if len(errors) == 0:
        message = "there are no vectors to rate"
        raise ValueError(message)
    index = np.minimum((expected * num_bins).astype(np.int64), num_bins - 1)
    right = errors < RIGHT
    bins = tuple(
        Bin(
            confidence=float(expected[index == number].mean()),
            hits=float(right[index == number].mean()),
            count=int((index == number).sum()),
        )
        for number in np.unique(index).tolist()
    )
    order = np.argsort(-expected, kind="stable")
    confident = errors[order[: (len(order) + 1) // 2]]
    distances = [each.count * abs(each.confidence - each.hits) for each in bins]
    return Reliability(
        bins=bins,
        calibration_error=sum(distances) / len(errors),
        gross=float((errors > GROSS).mean()),
        gross_confident=float((confident > GROSS).mean()),
    )


def measure(options: ReliabilityOptions) -> Iterator[tuple[Stream, Reliability]]:
    """Rate the vectors of every stream, with the shipped model.

    Raises
    ------
    DataError
        A sequence or encoder is not known, or a sequence has no point truth.
    """
    model = default_error_model()
    for stream, fields in streams(options):
        errors: list[NDArray[np.float64]] = []
        confidences: list[NDArray[np.float64]] = []
        for field, error in fields:
            judged = ~np.isnan(error)
            errors.append(error[judged])
            confidences.append(model.confidence(expected_error(field)[judged], RIGHT))
        yield stream, rate(np.concatenate(errors), np.concatenate(confidences))


def streams(
    options: ReliabilityOptions,
) -> Iterator[tuple[Stream, Iterator[tuple[MotionField, NDArray[np.float64]]]]]:
    """Encode the sequences, unless that was done, and compare their vectors with the truth.

    Yields
    ------
    stream : Stream
        What it is.
    fields : iterator
        As :func:`vector_errors` gives them.

    Raises
    ------
    DataError
        A sequence or encoder is not known, or a sequence has no point truth.
    """
    folders = find_sequences(options.data)
    for encoder in options.encoders:
        if encoder not in ENCODERS:
            raise DataError(f"there is no encoder {encoder}; there are {', '.join(ENCODERS)}")
    for name in options.sequences or tuple(folders):
        base = name.partition("+")[0]
        if base not in folders:
            raise DataError(f"there is no sequence {base}; there are {', '.join(folders)}")
        sequence = open_sequence(folders[base], name, options.max_frames)
        if sequence.truth is None:
            if options.sequences:
                raise DataError(f"{name} has no point truth to compare vectors with")
            continue
        clip = prepare_clip(sequence, folders[base], options.out, options.max_frames)
        for encoder in options.encoders:
            for quality in options.qualities:
                encode = dataclasses.replace(ENCODERS[encoder], quality=quality)
                path, _ = encoded_stream(clip, encode)
                stream = Stream(sequence=name, half=half_of(name), encoder=encoder, quality=quality)
                with open_video(path, threads=1) as video:
                    yield stream, vector_errors(video, sequence, step=options.step)


def vector_errors(
    fields: Iterable[MotionField], sequence: Sequence, *, step: int = 3
) -> Iterator[tuple[MotionField, NDArray[np.float64]]]:
    """Compare the vectors of a stream, fused with their neighbours, with the truth.

    Parameters
    ----------
    fields : iterable of MotionField
        Of the stream.
    sequence : Sequence
        Its frames, with point truth.
    step : int
        Only frames whose number it divides.

    Yields
    ------
    field : MotionField
        As it was.
    error : (N,) float64
        px; infinite where the target is hidden, NaN where the block's centre lies on something that
        moves by itself and where the reference is not in the sequence.
    """
    truth = sequence.truth
    if truth is None:
        message = f"{sequence.name} has no point truth to compare vectors with"
        raise DataError(message)
    for field in fields:
        if field.frame % step or field.frame >= len(sequence) or len(field) == 0:
            continue
        moved = field.centers.astype(np.float64) + fuse_neighbors(field).mv
        error = np.full(len(field), np.nan)
        for reference in np.unique(field.ref_frame).tolist():
            if not 0 <= reference < len(sequence):
                continue
            rows = np.flatnonzero(field.ref_frame == reference)
            target = truth.targets(field.frame, reference, field.centers[rows])
            found = point_error(moved[rows], target.xy, target.visible)
            error[rows] = np.where(target.moving, np.nan, found)
        yield field, error
