"""Options of a verb: preset, then file, then single values, then flags."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter, validators

from mvmatch.config import RunOptions, from_mapping, load_options
from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence

ExistingPath = Annotated[Path, Parameter(validator=validators.Path(exists=True))]
ExistingFile = Annotated[
    Path, Parameter(validator=validators.Path(exists=True, dir_okay=False, file_okay=True))
]
Output = Annotated[Path, Parameter(alias="-o")]
Json = Annotated[bool, Parameter(negative="", help="Print one JSON object on stdout.")]


class UsageError(Exception):
    """The words of the command line do not fit together."""


@Parameter(name="*")
@dataclass(kw_only=True)
class Settings:
    """Options that most verbs share."""

    preset: Literal["default", "dense", "fast", "paper"] = "default"
    """Rules of tracking: what measured best, the same with many more points, fewer tracks, or the
    paper's to the letter."""

    errors: Literal["raise", "resume"] | None = None
    """At damage in an AV1 stream: stop with the frames before it, or skip what was lost."""

    operating_point: int | None = None
    """Layers of a scalable AV1 stream to read; 0, the default, usually has all of them."""

    threads: int | None = None
    """Threads that read the AV1 stream; 0, the default, takes one per processor."""

    verify: Literal["tracks", "sampled", "all", "trust"] | None = None
    """Which image pairs get a geometry of their own: a few per frame, whose verdict tracks carry to
    the others (the default); every pair, from a sample or from all of its matches; or none."""

    config: ExistingFile | None = None
    """TOML file with options; `mvmatch run --print-config` shows one."""

    set: Annotated[
        list[str], Parameter(metavar="STAGE.NAME=VALUE", negative="", consume_multiple=False)
    ] = field(default_factory=list[str])
    """One option, such as track.max_gap=20; can be repeated."""

    def options(self) -> RunOptions:
        """Return the options of all stages."""
        options = RunOptions.preset(self.preset)
        if self.config is not None:
            options = load_options(self.config, options)
        options = apply_assignments(self.set, options)
        read = options.read
        if self.errors is not None:
            read = replace(read, errors=self.errors)
        if self.operating_point is not None:
            read = replace(read, operating_point=self.operating_point)
        if self.threads is not None:
            read = replace(read, threads=self.threads)
        verification = options.verification
        if self.verify is not None:
            verification = replace(verification, mode=self.verify)
        return replace(options, read=read, verification=verification)


def apply_assignments(assignments: Sequence[str], options: RunOptions) -> RunOptions:
    """Set single options by ``stage.name=value``; values are TOML, bare words are texts."""
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals or not name.strip():
            message = f"--set takes STAGE.NAME=VALUE, not {assignment!r}"
            raise UsageError(message)
        nested: Any = _value(text.strip())
        for word in reversed(name.strip().split(".")):
            nested = {word: nested}
        try:
            options = from_mapping(nested, options)
        except (DataError, ValueError) as error:
            message = f"--set {assignment}: {error}"
            raise UsageError(message) from error
    return options


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


Refine = Annotated[
    bool | None,
    Parameter(
        help="Align tracks to the pictures: exacter and slower; needs OpenCV. Without either, "
        "`mvmatch run` does so where the camera is unknown, and for what only makes a model denser."
    ),
]


def with_refinement(options: RunOptions, refine: Refine) -> RunOptions:
    """Return the options with the refinement on or off, if that was said."""
    if refine is None:
        return options
    return replace(options, refine=replace(options.refine, when="always" if refine else "never"))


BridgeMatcher = Annotated[
    Literal["sift", "aliked", "none"] | None,
    Parameter(
        help="What bridges gaps that vectors leave between pictures: descriptors by pycolmap "
        "(sift, the default; aliked where pycolmap has it), or nothing."
    ),
]


def with_bridge(options: RunOptions, matcher: BridgeMatcher) -> RunOptions:
    """Return the options with another matcher for gaps, if one was named."""
    if matcher is None:
        return options
    return replace(options, bridge=replace(options.bridge, matcher=matcher))


LoopMatcher = Annotated[
    Literal["sift", "aliked", "none"] | None,
    Parameter(
        help="What ties places together that the camera comes back to: descriptors by pycolmap "
        "(sift; aliked where pycolmap has it), or nothing (the default)."
    ),
]


def with_loops(options: RunOptions, matcher: LoopMatcher) -> RunOptions:
    """Return the options with another matcher for loops, if one was named."""
    if matcher is None:
        return options
    return replace(options, loops=replace(options.loops, matcher=matcher))


def with_encoder(options: RunOptions, encoder: Any) -> RunOptions:
    """Return the options with another encoder, if one was named."""
    if encoder is None:
        return options
    return replace(options, encode=replace(options.encode, encoder=encoder))
