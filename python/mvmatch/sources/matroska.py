"""Whether a Matroska or WebM file is as long as it says: demuxers end silently where it is cut."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

_EBML, _SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"
_MAX_EBML_HEADER = 4096


def missing_bytes(path: Path) -> int:
    """Bytes between the end of a file and the end that its Segment element announces.

    Parameters
    ----------
    path : Path
        Any file.

    Returns
    -------
    int
        0 for a complete file, for one whose length is left open (a live recording) and for
        anything that is not Matroska or WebM.

    References
    ----------
    RFC 8794, section 6 (element data size); RFC 9559, section 5.1 (Segment).
    """
    with path.open("rb") as file:
        head = file.read(_MAX_EBML_HEADER)
    if not head.startswith(_EBML):
        return 0
    start, size = _data_size(head, len(_EBML))
    position = start + (size or 0)
    if head[position : position + len(_SEGMENT)] != _SEGMENT:
        return 0
    start, size = _data_size(head, position + len(_SEGMENT))
    return 0 if size is None else max(0, start + size - path.stat().st_size)


def _data_size(data: bytes, position: int) -> tuple[int, int | None]:
    """Return where an element's data starts and its size, None when it is left open."""
    first = data[position] if position < len(data) else 0
    length = 9 - first.bit_length()
    if length > 8:
        return position, None
    value = int.from_bytes(data[position : position + length]) & ((1 << 7 * length) - 1)
    is_open = value == (1 << 7 * length) - 1
    return position + length, None if is_open else value
