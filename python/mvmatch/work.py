"""The work of a run: what each stage made, kept under a key that says what it depends on.

A stage's product is a folder of files and a record beside them. The folder is filled under a
temporary name and renamed, so what has its name is whole, whenever the run was stopped. The record
holds the key; a run that asks for another key makes the stage anew.
"""

from __future__ import annotations

import dataclasses
import errno
import hashlib
import json
import shutil
import sys
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mvmatch import __version__
from mvmatch.encode.frames import IMAGE_SUFFIXES
from mvmatch.errors import DataError, cannot_write
from mvmatch.measure import StageClock, StageCost

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Generator

FOLDER = ".work"
"""Name of the folder in that of the results."""

SCHEMA_VERSION = 3
"""Raised when a stage writes something else, or the same otherwise."""

_RECORD = "stage.json"
_LOCK = "lock"
_NO_PLACE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS}


@dataclass(frozen=True, kw_only=True)
class Product:
    """What a stage made."""

    folder: Path
    facts: dict[str, Any]
    """What it said beside its files, plain values."""
    cost: StageCost
    """When it was made."""


class Work:
    """The products in one folder; held by one run at a time (:func:`open_work`)."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @property
    def stages(self) -> list[str]:
        """Names of the stages that are kept."""
        if not self._folder.is_dir():
            return []
        entries = [path for path in self._folder.iterdir() if path.is_dir()]
        return sorted(path.name for path in entries if not path.name.startswith("."))

    def find(self, stage: str, key: str) -> Product | None:
        """Return the product of a stage if it is there, has this key, and nobody changed it."""
        folder = self._folder / stage
        try:
            record = json.loads((folder / _RECORD).read_text(encoding="utf-8"))
            if record["key"] != key or record["files"] != _files(folder):
                return None
            cost = StageCost(**record["cost"])
            return Product(folder=folder, facts=dict(record["facts"]), cost=cost)
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def make(
        self, stage: str, key: str, title: str, fill: Callable[[Path], dict[str, Any]]
    ) -> Product:
        """Let a stage fill a folder, and keep it in the place of an older product.

        Parameters
        ----------
        stage : str
            Name of the stage.
        key : str
            What the product depends on (:func:`digest`).
        title : str
            Name of the stage in reports.
        fill : callable
            Given an empty folder; returns the facts, plain values.

        Raises
        ------
        DataError
            There is no place for the product. Finished stages are kept.
        """
        clock = StageClock()
        with self.scratch() as folder:
            with clock.stage(title):
                facts = fill(folder)
            (cost,) = clock.stages
            record = {
                "key": key,
                "facts": facts,
                "cost": dataclasses.asdict(cost),
                "files": _files(folder),
            }
            (folder / _RECORD).write_text(json.dumps(record), encoding="utf-8")
            shutil.rmtree(self._folder / stage, ignore_errors=True)
            folder.replace(self._folder / stage)
        made = self.find(stage, key)
        if made is None:
            message = f"files of {self._folder / stage} change while a run is at work on them"
            raise DataError(f"{message}. Give a folder of its own with -o")
        return made

    @contextmanager
    def scratch(self) -> Generator[Path]:
        """Give a temporary folder beside the products; no place in it is an error of the data."""
        try:
            folder = Path(tempfile.mkdtemp(prefix=".unfinished-", dir=self._folder))
            try:
                yield folder
            finally:
                shutil.rmtree(folder, ignore_errors=True)
        except OSError as error:
            if error.errno not in _NO_PLACE:
                raise
            raise cannot_write(self._folder.parent, error) from error

    def forget(self, *, keep: Collection[str] = ()) -> None:
        """Remove the products of all stages but some, and what a killed run left unfinished."""
        for path in self._folder.iterdir():
            if path.is_dir() and path.name not in keep:
                shutil.rmtree(path, ignore_errors=True)


@contextmanager
def open_work(out: Path) -> Generator[Work]:
    """Open the work folder of a folder of results; it is gone afterwards if nothing is in it.

    Raises
    ------
    DataError
        Another run is at work there, or it cannot be written.
    """
    existed, folder = out.exists(), out / FOLDER
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / _LOCK).open("a")
    except OSError as error:
        raise cannot_write(out, error) from error
    work, held = Work(folder), False
    try:
        with lock:
            held = _locked(lock.fileno())
            if not held:
                message = f"another run is at work in {out}. Wait for it, or give another folder"
                raise DataError(message)
            work.forget(keep=work.stages)
            yield work
    except BaseException as error:
        if held and work.stages:
            kept = ", ".join(work.stages)
            error.add_note(f"what was finished is there for the next run into {out}: {kept}")
        raise
    finally:
        if held and not work.stages:
            shutil.rmtree(folder, ignore_errors=True)
            if not existed and out.is_dir() and not any(out.iterdir()):
                out.rmdir()


def digest(*facts: Any) -> str:
    """Return a key for plain values and option dataclasses, under this version of mvmatch."""
    text = json.dumps([SCHEMA_VERSION, __version__, *facts], sort_keys=True, default=_plain)
    return hashlib.sha256(text.encode()).hexdigest()


def identity(source: Path) -> list[Any]:
    """Return what tells an input from another one: path, sizes and times, not the content."""
    if not source.is_dir():
        return [str(source.resolve()), _size_and_time(source)]
    images = [path for path in source.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
    listed = {path.name: _size_and_time(path) for path in images}
    return [str(source.resolve()), listed]


def _plain(value: object) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    message = f"a key cannot depend on a {type(value).__name__}"
    raise TypeError(message)


def _files(folder: Path) -> dict[str, list[int]]:
    """Size and time of all files of a product."""
    return {
        path.relative_to(folder).as_posix(): _size_and_time(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != _RECORD
    }


def _size_and_time(path: Path) -> list[int]:
    facts = path.stat()
    return [facts.st_size, facts.st_mtime_ns]


def _locked(descriptor: int) -> bool:
    """Lock a file for this process; False when another one has it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        # Some network drives know no locks: there nobody is kept out.
        return error.errno not in {errno.EACCES, errno.EAGAIN, errno.EDEADLK}
    return True
