"""The layouts that are known, and finding and loading what has one of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mvmatch.bench.datasets import colmap, eth3d, kitti, nerf, plain, posed, tum
from mvmatch.bench.datasets.layout import GUIDE, Layout
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence as Many
    from pathlib import Path

    from mvmatch.bench.datasets.sequence import Sequence

LAYOUTS: tuple[Layout, ...] = (
    eth3d.LAYOUT, kitti.LAYOUT, tum.LAYOUT, nerf.LAYOUT, colmap.LAYOUT, posed.LAYOUT, plain.LAYOUT,
)  # fmt: skip
"""The first that recognises a place has it: those with the most telling files come first."""


def layout_of(place: Path) -> Layout | None:
    """Return the layout of a folder or file, None where nothing is recognised."""
    return next((layout for layout in LAYOUTS if layout.recognises(place)), None)


def find_sequences(folders: Many[Path]) -> dict[str, Path]:
    """Find sequences: each folder is one itself, or holds some.

    Parameters
    ----------
    folders : sequence of Path
        Those inside them, and inside their folder ``sequences``, count if their files say what
        they are; other folders are passed over. Pictures without anything that says so, and
        videos, only count where they are named themselves.

    Returns
    -------
    dict
        Name to folder, sorted by name.

    Raises
    ------
    DataError
        A folder holds no sequence, or two sequences have one name.
    """
    found: dict[str, Path] = {}
    for folder in folders:
        if not folder.exists():
            raise DataError(f"there is no folder {folder}; give one that holds sequences")
        for path in _sequences_at(folder):
            name = _name(path)
            if name in found:
                raise DataError(f"two sequences are named {name}: {found[name]} and {path}")
            found[name] = path
    return dict(sorted(found.items()))


def load_sequence(folder: Path) -> Sequence:
    """Read one sequence in any of the known layouts.

    Raises
    ------
    DataError
        The folder has none of the layouts, or its files do not fit together; the message says
        which file and what was expected.
    """
    layout = layout_of(folder)
    if layout is None:
        raise DataError(
            f"{folder} is no sequence: it has no folder images/ nor files of another layout. "
            f"{GUIDE} shows those of {', '.join(known.title for known in LAYOUTS)}"
        )
    return layout.load(folder)


def _sequences_at(place: Path) -> list[Path]:
    if _says_what_it_is(place):
        return [place]
    inner = [*place.glob("*"), *(place / "sequences").glob("*")]
    inner = sorted(path for path in inner if _says_what_it_is(path))
    if not inner and plain.LAYOUT.recognises(place):
        inner = [place]
    if not inner:
        raise DataError(
            f"{place} holds no sequence: a sequence is a folder with images/, or as {GUIDE} shows"
        )
    return inner


def _says_what_it_is(place: Path) -> bool:
    return place.is_dir() and layout_of(place) not in (None, plain.LAYOUT)


def _name(place: Path) -> str:
    layout = layout_of(place)
    assert layout is not None
    name = layout.name(place)
    if "+" in name:
        raise DataError(f"{place}: a plus sign begins the name of a composition; rename it")
    return name
