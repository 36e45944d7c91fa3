"""Sequences with known camera poses, from the folders of the data sets themselves.

A layout (:data:`LAYOUTS`) is recognised by its files and loaded by one module here; a further one
is a module and an entry there. Nothing is downloaded: docs/reference/datasets.md says how to get
the data.
"""

from mvmatch.bench.datasets.checksums import CHECKSUMS, verify_checksums
from mvmatch.bench.datasets.find import LAYOUTS, find_sequences, layout_of, load_sequence
from mvmatch.bench.datasets.sequence import (
    SPLIT_RULE,
    Frames,
    Half,
    ImageFiles,
    Sequence,
    half_of,
    write_frames,
)

__all__ = [
    "CHECKSUMS", "LAYOUTS", "SPLIT_RULE", "Frames", "Half", "ImageFiles", "Sequence",
    "find_sequences", "half_of", "layout_of", "load_sequence", "verify_checksums", "write_frames",
]  # fmt: skip
