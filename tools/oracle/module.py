"""The compiled module: the one with the test-only trace if it can be had."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
TARGET = REPOSITORY / "target" / "trace"
LIBRARIES = ("lib_core.so", "lib_core.dylib", "_core.dll")


def build_trace_module() -> str:
    """Build the module with the feature ``trace``; what went wrong, or nothing."""
    if shutil.which("cargo") is None:
        return "cargo is not installed"
    command = ["cargo", "build", "--release", "--quiet", "-p", "mvmatch-python"]
    command += ["--features", "trace", "--target-dir", str(TARGET)]
    result = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    return result.stderr.strip() if result.returncode else ""


def use_trace_module(*, build: bool = True) -> str:
    """Let ``import mvmatch._core`` find the module with the trace; a sentence on the outcome."""
    problem = build_trace_module() if build else ""
    found = [TARGET / "release" / name for name in LIBRARIES]
    library = next((path for path in found if path.exists()), None)
    if problem or library is None:
        return f"NO TRACE: {problem or f'{found[0]} was not built'}"
    loader = importlib.machinery.ExtensionFileLoader("mvmatch._core", str(library))
    spec = importlib.util.spec_from_file_location("mvmatch._core", library, loader=loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["mvmatch._core"] = module
    loader.exec_module(module)
    import mvmatch

    mvmatch.__dict__["_core"] = module
    return f"trace: {library.relative_to(REPOSITORY)}"
