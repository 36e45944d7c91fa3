"""Fit the error model of motion vectors to sequences with exact truth.

    python tools/fit_error_model.py SEQUENCES... --names street_turn,orbit_object,terrain_drone

Encodes the first frames of each sequence with every encoder and at several qualities, compares all
fused vectors with the truth, and writes python/mvmatch/error_model.toml: the logarithm of the error
as a linear function of the evidence (least squares, every stream with the same weight), and the
scale of what is left as that of a logistic distribution. Name the sequences of the tuning half:
what the model is judged by must not have taught it. Needs the extra ``bench``.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import mvmatch
from mvmatch.bench.datasets import Sequence, find_sequences, load_sequence, write_frames
from mvmatch.bench.reliability import vector_errors
from mvmatch.confidence import EVIDENCE, MODEL_PATH
from mvmatch.encode import EncodeOptions, encode_video

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

ENCODERS = {
    "svt": EncodeOptions(encoder="svt"),
    "libaom realtime": EncodeOptions(encoder="libaom", usage="realtime"),
    "libaom good": EncodeOptions(encoder="libaom", usage="good"),
}
