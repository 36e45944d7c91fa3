"""Errors of mvmatch: each says whose fault it is, where, and what to do next."""

from __future__ import annotations

import os


class MvmatchError(Exception):
    """Base class of every error that mvmatch raises on purpose."""


class BitstreamError(MvmatchError, ValueError):
    """The stream breaks the AV1 specification (or its container does)."""

    def __init__(
        self,
        message: str,
        *,
        section: str | None = None,
        byte_offset: int | None = None,
        frame: int | None = None,
    ) -> None:
        super().__init__(message)
        self.section = section
        self.byte_offset = byte_offset
        self.frame = frame


class UnsupportedError(MvmatchError, NotImplementedError):
    """The input is valid but uses something mvmatch does not handle; the message names it."""


class NotAv1Error(UnsupportedError):
    """The video is of another codec: it has to be encoded first."""


class LimitError(MvmatchError):
    """The input asks for more than the configured limits allow."""


class InternalError(MvmatchError):
    """A fault of mvmatch itself: a bug worth reporting, whatever the input was."""


class MissingExtraError(MvmatchError, ImportError):
    """An optional dependency is not installed; the message holds the pip line."""


class DataError(MvmatchError, ValueError):
    """An input other than the bitstream (images, camera, tables) cannot be used."""


def cannot_write(path: object, error: OSError) -> DataError:
    """Return the error for a result that has no place."""
    reason = str(error) if error.errno is None else os.strerror(error.errno)
    if isinstance(error, FileExistsError | NotADirectoryError):
        reason = "a part of this path is a file, not a folder"
    return DataError(f"cannot write {path} ({reason}). Choose another place")
