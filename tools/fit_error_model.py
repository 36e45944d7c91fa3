"""Fit the error model of motion vectors to sequences with exact truth.

    python tools/fit_error_model.py FOLDER --sequences street_turn,orbit_object,terrain_drone

Encodes the first frames of each sequence with every encoder at several qualities, compares the
fused vectors with the truth, and writes python/mvmatch/error_model.toml: the logarithm of the error
as a linear function of the evidence (least squares, every stream with the same weight), and the
scale of what is left as that of a logistic distribution. Name the sequences of the tuning half:
what the model is judged by must not have taught it. Needs the extra ``bench``.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mvmatch import confidence
from mvmatch.bench.reliability import ReliabilityOptions, streams
from mvmatch.confidence import EVIDENCE, MODEL_FILE, ErrorModel, evidence

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

SMALLEST, LARGEST = 0.02, 8.0
"""px; errors are taken to lie between: nothing is more exact than the vectors' steps, and how far a
gross error is off tells nothing. A hidden target is off by the largest."""


def fit_error_model(
    samples: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> ErrorModel:
    """Fit the model to the vectors of several streams, each stream with the same weight.

    Parameters
    ----------
    samples : sequence of ((N, 6), (N,)) float64
        Evidence and error in px of each stream; infinite errors are hidden targets.

    Returns
    -------
    ErrorModel
        With the least squares weights.
    """
    x = np.concatenate([evidence for evidence, _ in samples])
    y = np.log(np.clip(np.concatenate([error for _, error in samples]), SMALLEST, LARGEST))
    root = np.concatenate([np.full(len(error), len(error) ** -0.5) for _, error in samples])
    weights = np.linalg.lstsq(x * root[:, None], y * root)[0]
    variance = np.average((y - x @ weights) ** 2, weights=root**2)
    # A logistic distribution of scale s has the variance (pi s)^2 / 3.
    scale = math.sqrt(3 * variance) / math.pi
    return ErrorModel(weights=tuple(weights.tolist()), scale=scale)


def to_toml(model: ErrorModel, source: str) -> str:
    """Return the file of a model; ``source`` is a comment on what it was made from."""
    lines = [f"# Made by tools/fit_error_model.py from {source}."]
    lines += [f"scale = {model.scale:.3f}", "", "[weights]"]
    lines += [f"{name} = {w:.3f}" for name, w in zip(EVIDENCE, model.weights, strict=True)]
    return "\n".join(lines) + "\n"


def sample_streams(
    options: ReliabilityOptions,
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return evidence and errors of every stream, without unconfirmed and moving points."""
    samples: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    for stream, fields in streams(options):
        found = [(evidence(field), error) for field, error in fields]
        x = np.concatenate([columns for columns, _ in found])
        error = np.concatenate([error for _, error in found])
        used = ~np.isnan(error) & np.isfinite(x).all(axis=1)
        samples.append((x[used], error[used]))
        print(f"{stream.sequence} {stream.encoder} {stream.quality}: {used.sum()}", file=sys.stderr)
    return samples


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "data", type=Path, nargs="+", help="folders that are sequences or hold some"
    )
    parser.add_argument("--sequences", required=True, help="names, separated by commas")
    parser.add_argument("--qualities", default="20,30,45", help="of both encoders' CRF scale")
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--streams", type=Path, default=Path("out/confidence"), help="kept here")
    arguments = parser.parse_args()
    options = ReliabilityOptions(
        data=tuple(arguments.data),
        out=arguments.streams,
        sequences=tuple(arguments.sequences.split(",")),
        qualities=tuple(int(quality) for quality in arguments.qualities.split(",")),
        max_frames=arguments.frames,
    )
    model = fit_error_model(sample_streams(options))
    source = (
        f"{', '.join(options.sequences)}; {', '.join(options.encoders)}; "
        f"quality {', '.join(map(str, options.qualities))}; {options.max_frames} frames"
    )
    path = Path(confidence.__file__).with_name(MODEL_FILE)
    path.write_text(to_toml(model, source), encoding="utf-8")
    print(path.read_text(encoding="utf-8"), end="")


if __name__ == "__main__":
    main()
