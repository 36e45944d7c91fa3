"""Fixtures that every test may use."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from browser import Browser, executable

if TYPE_CHECKING:
    from collections.abc import Iterator

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


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Headless Chromium or Chrome; without one the test is skipped."""
    path = executable()
    if path is None:
        pytest.skip("no Chromium or Chrome is on the PATH (Debian: apt-get install chromium)")
    with Browser(path) as running:
        yield running
