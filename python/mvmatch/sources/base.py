"""What a motion source is, and which one reads a given file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol

from mvmatch.errors import DataError, NotAv1Error
from mvmatch.sources.options import Limits, ReadOptions

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from os import PathLike
    from types import TracebackType

    from mvmatch.sources.frames import FrameFacts
    from mvmatch.sources.options import Errors, Skipped
    from mvmatch.types import MotionField, VideoInfo

Kind = Literal["av1-elementary", "container", "text", "empty", "unknown"]

_ELEMENTARY_SUFFIXES = {".ivf", ".obu", ".av1", ".annexb"}
_HEAD_BYTES = 4096


class MotionSource(Protocol):
    """A video as a stream of motion fields, in decode order.

    A source is a context manager and can be iterated once. When the stream is damaged it yields
    every field before the damage and then raises, or goes on if it was opened to ``"resume"``.
    """

    @property
    def info(self) -> VideoInfo:
        """What is known about the video before it is read."""
        ...

    @property
    def frames(self) -> Sequence[FrameFacts]:
        """Header facts of the frames read so far."""
        ...

    @property
    def skipped(self) -> Sequence[Skipped]:
        """What could not be read so far; empty unless the source goes on after damage."""
        ...

    def __iter__(self) -> Iterator[MotionField]: ...

    def __enter__(self) -> MotionSource: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


def sniff(path: Path) -> Kind:
    """Tell from its first bytes (never from its name) what a file is.

    Parameters
    ----------
    path : Path
        An existing file.

    Returns
    -------
    str
        ``"av1-elementary"`` (IVF, Section 5, Annex B), ``"container"`` (worth asking a demuxer),
        ``"text"``, ``"empty"`` or ``"unknown"``.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if not head:
        return "empty"
    if head.startswith((b"DKIF", b"\x12\x00")) or _looks_like_annexb(head):
        return "av1-elementary"
    if head[4:8] == b"ftyp" or head.startswith((b"\x1a\x45\xdf\xa3", b"RIFF", b"\x47", b"\0\0")):
        return "container"
    if _looks_like_text(head):
        return "text"
    return "av1-elementary" if path.suffix.lower() in _ELEMENTARY_SUFFIXES else "unknown"


def open_video(
    path: str | PathLike[str],
    *,
    errors: Errors = "raise",
    limits: Limits | None = None,
    operating_point: int = 0,
    threads: int = 0,
) -> MotionSource:
    """Open a video and read its motion vectors; no pixel is decoded.

    Parameters
    ----------
    path : path
        AV1 as IVF, Section 5 OBU stream, Annex B, MP4, MKV or WebM.
    errors : {"raise", "resume"}
        What happens at damage: an error after the fields before it, or reading on at the first
        frame that depends on nothing that was lost; ``source.skipped`` then says what was left out.
        Nothing is guessed either way. Limits, unsupported tools and files that cannot be read are
        errors always. After a frame header that is lost, display indices may be too small by the
        number of pictures that nothing in the stream tells of.
    limits : Limits, optional
        What the stream may cost; :class:`~mvmatch.sources.Limits` with its defaults without.
    operating_point : int
        Which of a scalable stream's operating points to read: 0 usually has all layers, others
        leave temporal or spatial layers out.
    threads : int
        Threads of the parser; 0 for one per processor. Any number gives the same fields.

    Returns
    -------
    MotionSource
        An iterator of motion fields; use it as a context manager.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    DataError
        The file is empty, is text, holds no video or has no such operating point.
    NotAv1Error
        The video is of another codec.
    UnsupportedError
        Its first frame uses a coding tool that is not handled.
    BitstreamError
        The stream is damaged before its first frame is complete; to resume, no frame can be read.
    LimitError
        Its first frame asks for more than ``limits`` allow.
    """
    path = Path(path)
    if operating_point < 0:
        message = f"operating points are counted from 0; there is no {operating_point}"
        raise DataError(message)
    if threads < 0:
        message = f"the parser cannot have {threads} threads; 0 takes one per processor"
        raise ValueError(message)
    if not path.exists():
        message = f"there is no file {path}"
        raise FileNotFoundError(message)
    if path.is_dir():
        message = (
            f"{path} is a folder, not a video. Encode its frames first: "
            f"mvmatch encode {path} clip.ivf (or let `mvmatch run` do it)"
        )
        raise DataError(message)
    kind = sniff(path)
    if kind == "empty":
        message = f"{path} is empty (0 bytes). Was it copied or downloaded completely?"
        raise DataError(message)
    if kind == "text":
        message = f"{path} is a text file, not a video. Give an AV1 video or a folder of frames"
        raise DataError(message)

    from mvmatch.sources import av1

    options = ReadOptions(
        errors=errors,
        limits=limits or Limits(),
        operating_point=operating_point,
        threads=threads,
    )
    if kind == "av1-elementary":
        return av1.open_elementary(path, options=options)
    return av1.open_demuxed(path, options=options)


def unsupported_codec(path: Path, codec: str) -> NotAv1Error:
    """Return the error for a video that is not AV1, with the way out."""
    return NotAv1Error(
        f"{path} holds {codec} video; motion vectors are read from AV1 only. "
        f"Re-encode it: mvmatch encode {path} {path.stem}.ivf (or let `mvmatch run` do it)"
    )


def _looks_like_text(head: bytes) -> bool:
    if b"\0" in head:
        return False
    try:
        text = head.decode("utf-8", errors="strict" if len(head) < _HEAD_BYTES else "ignore")
    except UnicodeDecodeError:
        return False
    return all(character.isprintable() or character.isspace() for character in text)


def _looks_like_annexb(head: bytes) -> bool:
    """Annex B: three sizes, then a temporal delimiter OBU (type 2, no extension, no payload)."""
    position = 0
    for _ in range(2):  # temporal_unit_size, frame_unit_size: leb128
        for _ in range(8):
            if position >= len(head):
                return False
            position += 1
            if not head[position - 1] & 0x80:
                break
    return head[position : position + 2] == b"\x01\x10" or (
        head[position : position + 3] == b"\x02\x12\x00"
    )
