"""Encode frames or any video into AV1 that is made for matching.

Matching wants what broadcasting avoids: one key frame, references in the past only, and vectors
to the previous frame as far as the encoder allows. :func:`encode_video` sets an encoder up that
way and checks the result with mvmatch's own parser.
"""

from __future__ import annotations

from mvmatch.encode.check import EncodingCheck
from mvmatch.encode.options import ENCODER_NAMES, EncodeOptions, EncodeResult, EncoderName
from mvmatch.encode.run import encode_video
from mvmatch.encode.status import EncoderStatus, available_encoders

__all__ = [
    "ENCODER_NAMES",
    "EncodeOptions",
    "EncodeResult",
    "EncoderName",
    "EncoderStatus",
    "EncodingCheck",
    "available_encoders",
    "encode_video",
]
