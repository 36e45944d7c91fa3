"""Fixtures that every test may use."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def repository() -> Path:
    """Folder of the whole repository."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of measured sequences beside the repository; without it the test is skipped."""
    folder = Path(os.environ.get("MVMATCH_SHARED", REPOSITORY.parent / "shared"))
    if not folder.is_dir():
        pytest.skip(f"the measured sequences are not at {folder} (set MVMATCH_SHARED)")
    return folder


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of the small streams that belong to the repository."""
    return REPOSITORY / "tests" / "data"
