"""The command line: each verb reads what the one before it wrote."""

from __future__ import annotations

from mvmatch.cli.app import main

__all__ = ["main"]
