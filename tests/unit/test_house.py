"""The package as a whole."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

HEAVY = (
    "av",
    "pycolmap",
    "pyarrow",
    "matplotlib",
    "cyclopts",
    "rich",
    "cv2",
    "h5py",
    "scipy",
    "torch",
    "kornia",
    "threadpoolctl",
    "yaml",
)


def test_importing_mvmatch_brings_numpy_alone() -> None:
    code = f"import sys, mvmatch; print([m for m in {HEAVY!r} if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


TABLES = """
import sys, pathlib
from mvmatch.store import TracksTable, read_tracks, write_tracks
from mvmatch.types import Tracks, VideoInfo

path = pathlib.Path(sys.argv[1])
info = VideoInfo(width=8, height=8, num_frames=2, frame_rate=25.0, codec="av1")
tracks = Tracks.from_lists([(0, 1.0, 1.0), (1, 2.0, 1.0)])
write_tracks(TracksTable(tracks=tracks, info=info, image_names=("a", "b")), path, options={})
print(len(read_tracks(path).tracks), "pandas" in sys.modules)
"""


def test_tables_do_not_bring_pandas(tmp_path: Path) -> None:
    """Its import costs more than the vectors of ten pictures."""
    command = [sys.executable, "-c", TABLES, str(tmp_path / "tracks.parquet")]
    found = subprocess.run(command, capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["1", "False"]


def test_every_public_name_can_be_reached() -> None:
    import mvmatch

    for name in mvmatch.__all__:
        assert getattr(mvmatch, name) is not None
    assert set(mvmatch.__all__) <= set(dir(mvmatch))
