"""The options of all stages in one place, as TOML and back.

Options live beside the stage they steer; this module only nests them. In TOML an option that is off
(None in Python) is written as ``"off"``.
"""

from __future__ import annotations

import dataclasses
import tomllib
import types
import typing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from mvmatch.bridge import BridgeOptions, LoopOptions
from mvmatch.encode import EncodeOptions
from mvmatch.errors import DataError
from mvmatch.export.verification import VerificationOptions
from mvmatch.footage import FootageOptions
from mvmatch.geometry.movers import MoverOptions
from mvmatch.refine import RefineOptions
from mvmatch.sfm import DensifyOptions, MapperOptions
from mvmatch.sources import ReadOptions
from mvmatch.tracks import TrackOptions

if TYPE_CHECKING:
    from collections.abc import Mapping

    from mvmatch.types import StrPath

OFF = "off"
Options = TypeVar("Options")


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of a whole run, one table per stage."""

    read: ReadOptions = field(default_factory=ReadOptions)
    """What a stream may cost, what happens where it is damaged, and which layers are read."""
    encode: EncodeOptions = field(default_factory=EncodeOptions)
    """Frames or other video to AV1."""
    track: TrackOptions = field(default_factory=lambda: TrackOptions.preset("default"))
    """Motion to tracks."""
    footage: FootageOptions = field(default_factory=FootageOptions)
    """Cuts, repeated pictures and static overlays."""
    movers: MoverOptions = field(default_factory=MoverOptions)
    """Tracks that move by themselves."""
    refine: RefineOptions = field(default_factory=RefineOptions)
    """Tracks to tracks aligned to the pictures; off unless enabled."""
    bridge: BridgeOptions = field(default_factory=BridgeOptions)
    """Gaps that vectors leave between pictures, bridged by descriptors."""
    loops: LoopOptions = field(default_factory=LoopOptions)
    """Places seen again much later, matched by descriptors; off unless there is a matcher."""
    verification: VerificationOptions = field(default_factory=VerificationOptions)
    """Matches to two-view geometries."""
    mapper: MapperOptions = field(default_factory=MapperOptions)
    """Database to model."""
    densify: DensifyOptions = field(default_factory=DensifyOptions)
    """Further tracks (``track.fill``) to points of the finished model."""

    @classmethod
    def preset(cls, name: str) -> RunOptions:
        """Return the options that go with a preset of tracking.

        ``paper`` has vectors alone: it bridges no gaps and refines nothing.

        Raises
        ------
        ValueError
            There is no such preset (:meth:`mvmatch.tracks.TrackOptions.preset`).
        """
        track = TrackOptions.preset(name)
        if name != "paper":
            return cls(track=track)
        without = BridgeOptions(matcher="none")
        return cls(track=track, bridge=without, refine=RefineOptions(when="never"))


def load_options(path: StrPath, base: RunOptions | None = None) -> RunOptions:
    """Read a TOML file over ``base``.

    Raises
    ------
    DataError
        It is not TOML, names an unknown option, or a value has another type.
    """
    path = Path(path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        message = f"{path} is not valid TOML: {error}"
        raise DataError(message) from error
    try:
        return from_mapping(data, base or RunOptions())
    except DataError as error:
        message = f"{path}: {error}"
        raise DataError(message) from error


def from_mapping(data: Mapping[str, Any], base: Options, *, where: str = "") -> Options:
    """Return ``base`` with the values of nested mappings in the place of its own."""
    hints = typing.get_type_hints(type(base))
    names = {item.name for item in dataclasses.fields(cast("Any", base))}
    changed: dict[str, Any] = {}
    for name, value in data.items():
        place = f"{where}{name}"
        if name not in names:
            message = f"unknown option {place}; there are: {', '.join(sorted(names))}"
            raise DataError(message)
        current = getattr(base, name)
        if dataclasses.is_dataclass(current):
            if not isinstance(value, dict):
                message = f"{place} is a table of options, not a value"
                raise DataError(message)
            inner = cast("dict[str, Any]", value)
            changed[name] = from_mapping(inner, current, where=f"{place}.")
        else:
            changed[name] = _checked(value, hints[name], place)
    return cast("Options", dataclasses.replace(cast("Any", base), **changed))


def to_mapping(options: Any) -> dict[str, Any]:
    """Return options as nested plain values; None stays None."""
    return dataclasses.asdict(options)


def to_toml(options: Any, *, table: str = "") -> str:
    """Write options as TOML that :func:`load_options` reads back to equal options."""
    values: list[str] = []
    tables: list[str] = []
    for item in dataclasses.fields(options):
        value = getattr(options, item.name)
        if dataclasses.is_dataclass(value):
            name = f"{table}{item.name}"
            tables.append(f"[{name}]\n{to_toml(value, table=f'{name}.')}")
        else:
            values.append(f"{item.name} = {_toml_value(value)}\n")
    return "".join(values) + ("\n" if values and tables else "") + "\n".join(tables)


def _checked(value: Any, hint: Any, place: str) -> Any:
    """Return the value as the type its option has."""
    choices = typing.get_args(hint) if _is_union(hint) else (hint,)
    if value == OFF and type(None) in choices:
        return None
    for choice in choices:
        converted = _converted(value, choice)
        if converted is not None:
            return converted
    expected = " or ".join(_described(choice) for choice in choices)
    message = f"{place} must be {expected}, not {value!r}"
    raise DataError(message)


def _converted(value: Any, choice: Any) -> Any:
    """Return the value if ``choice`` admits it, else None."""
    origin = typing.get_origin(choice)
    if origin is typing.Literal:
        return value if value in typing.get_args(choice) else None
    if origin is tuple:
        return tuple(cast("list[Any]", value)) if isinstance(value, list) else None
    if choice is float and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if choice in {int, str, bool} and type(value) is choice:
        return value
    return None


def _described(choice: Any) -> str:
    if typing.get_origin(choice) is typing.Literal:
        return " or ".join(repr(value) for value in typing.get_args(choice))
    if choice is type(None):
        return repr(OFF)
    names = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
    return names.get(choice, str(choice))


def _is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in {typing.Union, types.UnionType}


def _toml_value(value: Any) -> str:
    if value is None:
        return f'"{OFF}"'
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    if isinstance(value, tuple | list):
        items = cast("list[Any]", value)
        return f"[{', '.join(_toml_value(item) for item in items)}]"
    return repr(value)
