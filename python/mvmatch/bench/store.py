"""Results as one file per cell, kept as long as what they depend on stays the same."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

Result = dict[str, Any]
"""Plain values; ``key`` and ``error`` (None or the reason) are always there."""


class Storable(Protocol):
    """Something to be computed whose result is a file."""

    @property
    def path(self) -> Path:
        """File of the result."""
        ...

    @property
    def key(self) -> str:
        """Digest of everything the result depends on."""
        ...


CellType = TypeVar("CellType", bound=Storable)


def fill_cells(
    cells: Sequence[CellType],
    compute: Callable[[CellType], Result],
    tell: Callable[[CellType, str], None] | None,
) -> list[Result]:
    """Compute what is not on file and return the results of all cells.

    Parameters
    ----------
    cells : sequence
        What is wanted.
    compute : callable
        Gives the result of one cell; a failure is a result with an ``error``.
    tell : callable
        Told about every cell: ``"kept"`` or ``"running"`` before, ``"done"`` or the reason it
        failed after. None: nobody is.
    """
    tell = tell or _untold
    results: list[Result] = []
    for cell in cells:
        result = stored(cell.path, cell.key)
        if result is not None:
            tell(cell, "kept")
        else:
            tell(cell, "running")
            result = compute(cell)
            write_json(cell.path, result)
            tell(cell, result["error"] or "done")
        results.append(result)
    return results


def stored(path: Path, key: str) -> Result | None:
    """Return the result on file if it was computed from the same things and did not fail."""
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    fresh = result.get("key") == key and result.get("error") is None
    return result if fresh else None


def write_json(path: Path, value: Result) -> None:
    """Write JSON with the infinities of failures kept (Python's dialect)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(json.dumps(value), encoding="utf-8")
    partial.replace(path)


def _untold(cell: Storable, state: str) -> None:
    """Tell nobody."""
