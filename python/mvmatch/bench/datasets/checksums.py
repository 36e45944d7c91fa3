"""Whether the files of a data set are what they were."""

from __future__ import annotations

import hashlib
import re
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from mvmatch.errors import DataError

if TYPE_CHECKING:
    from pathlib import Path

CHECKSUMS = "checksums.sha256"
"""As ``sha256sum`` writes it: 64 hexadecimal digits, two characters, a path relative to it."""

_LINE = re.compile(r"([0-9a-fA-F]{64}) [ *](.+)")
_SHOWN = 3


def verify_checksums(folder: Path) -> int:
    """Compare the files of a folder with its ``checksums.sha256``.

    Parameters
    ----------
    folder : Path
        Holds the list. Files that it does not name are not looked at.

    Returns
    -------
    int
        Files compared, all of which are right.

    Raises
    ------
    DataError
        There is no list, it is none, or files are missing or other than it says.
    """
    path = folder / CHECKSUMS
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(
            f"{path} cannot be read ({error}). `sha256sum FILES > {CHECKSUMS}` in {folder} makes it"
        ) from error
    sums = dict(_parsed(line, f"{path}, line {n}") for n, line in enumerate(lines, start=1) if line)
    if not sums:
        raise DataError(f"{path} is empty: it vouches for nothing. Make it anew")
    missing = [name for name in sums if not (folder / name).is_file()]
    changed = [
        name for name, digest in sums.items()
        if name not in missing and _digest(folder / name) != digest
    ]  # fmt: skip
    if missing or changed:
        raise DataError(
            f"{folder}: of {len(sums)} files {len(missing)} are missing{_listed(missing)} and "
            f"{len(changed)} are not as {CHECKSUMS} says{_listed(changed)}. Get these again"
        )
    return len(sums)


def _parsed(line: str, where: str) -> tuple[str, str]:
    """Name and digest of a line; names do not lead out of the folder."""
    found = _LINE.fullmatch(line)
    if found is None:
        raise DataError(f"{where}: a SHA-256 and a path belong there, as sha256sum writes them")
    name = PurePosixPath(found.group(2))
    if name.is_absolute() or ".." in name.parts:
        raise DataError(f"{where}: {name} leads out of the folder")
    return str(name), found.group(1).lower()


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _listed(names: list[str]) -> str:
    if not names:
        return ""
    return f" ({', '.join(names[:_SHOWN])}{', …' if len(names) > _SHOWN else ''})"
