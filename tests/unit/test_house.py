"""The package as a whole."""

from __future__ import annotations

import subprocess
import sys

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
    "yaml",
)


def test_importing_mvmatch_brings_numpy_alone() -> None:
    code = f"import sys, mvmatch; print([m for m in {HEAVY!r} if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_every_public_name_can_be_reached() -> None:
    import mvmatch

    for name in mvmatch.__all__:
        assert getattr(mvmatch, name) is not None
    assert set(mvmatch.__all__) <= set(dir(mvmatch))
