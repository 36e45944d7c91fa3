"""What the protocol runs, as a TOML file: ``configs/paper.toml`` and ``configs/default.toml``."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from mvmatch.config import from_mapping
from mvmatch.errors import DataError
from mvmatch.export.verification import VerificationOptions
from mvmatch.geometry.two_view import RansacOptions

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class ProtocolOptions:
    """What is run and how it is judged; the same for every method."""

    name: str = "default"
    """Of the experiment, for titles."""
    sequences: tuple[str, ...] = ()
    """Names, with ``+composition`` for composed ones; empty: every sequence as it is."""
    methods: tuple[str, ...] = ("svt-default", "svt-paper", "sift", "klt", "dis")
    """Names, or patterns as of file names, of :data:`mvmatch.bench.protocol_methods.METHODS`."""
    max_frames: int | None = None
    """First frames of each sequence."""
    gaps: tuple[int, ...] = (1, 10)
    """Frames between the two of a pair; every such pair of the sequence counts."""
    repetitions: int = 5
    """Estimations of every pair; each has a seed of its own, from ``ransac.seed`` upward."""
    ransac: RansacOptions = field(default_factory=RansacOptions)
    """Of the estimations, and of the verification before mapping."""
    max_sample: int | None = None
    """Correspondences that an estimation sees; all are tested."""
    map: bool = True
    """Also reconstruct."""
    threads: int = 1
    """Of reading, extraction, matching and tracking; mapping takes one, so that it repeats."""
    interval_s: float = 0.2
    """s between samples of CPU time and memory."""
    timeout_s: float = 3600.0
    """Elapsed time, s, after which a method is ended."""

    def __post_init__(self) -> None:
        for name, kind in (("sequences", str), ("methods", str), ("gaps", int)):
            for value in getattr(self, name):
                if type(value) is not kind:
                    what = "texts" if kind is str else "whole numbers"
                    raise DataError(f"{name} must be a list of {what}; it holds {value!r}")
        if not self.gaps or min(self.gaps) < 1:
            raise DataError(f"gaps must hold numbers of frames from 1 on, not {self.gaps}")
        bounds = {"repetitions": 1, "threads": 1, "interval_s": 0.01, "timeout_s": 0.0}
        for name, least in bounds.items():
            if getattr(self, name) < least:
                raise DataError(f"{name} must be at least {least:g}, not {getattr(self, name)}")
        for name in ("max_frames", "max_sample"):
            value = getattr(self, name)
            if value is not None and value < 2:
                raise DataError(f'{name} must be "off" or at least 2, not {value}')

    @property
    def verification(self) -> VerificationOptions:
        """Of every method's matches before mapping."""
        if self.max_sample is None:
            return VerificationOptions(mode="all", ransac=self.ransac)
        return VerificationOptions(mode="sampled", max_sample=self.max_sample, ransac=self.ransac)


def load_protocol(path: Path) -> ProtocolOptions:
    """Read a TOML file; what it does not name keeps its default.

    Raises
    ------
    DataError
        It cannot be read, is not TOML, or a key is unknown or has a wrong value; the message names
        the key.
    """
    try:
        data: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
        return from_mapping(data, ProtocolOptions())
    except OSError as error:
        raise DataError(
            f"{path} cannot be read ({error.strerror}). Give a TOML file such as "
            "configs/paper.toml, or one of the verbs of mvmatch bench"
        ) from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise DataError(f"{path} is not valid TOML: {error}") from error
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def settings(options: ProtocolOptions) -> dict[str, Any]:
    """Return what the result of one cell depends on, by name."""
    chosen = {"sequences", "methods", "name", "timeout_s"}
    return {
        each.name: getattr(options, each.name)
        for each in fields(options)
        if each.name not in chosen
    }
