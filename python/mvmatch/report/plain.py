"""Turn the facts of a run into plain JSON values."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any, cast

import numpy as np

Facts = dict[str, Any]
"""A JSON object."""


def part(facts: Facts, key: str) -> Facts:
    """Return the object under a key, empty when it is missing or null."""
    return facts.get(key) or {}


def items(facts: Facts, key: str) -> list[Any]:
    """Return the list under a key, empty when it is missing or null."""
    return facts.get(key) or []


def plain(value: object) -> Any:
    """Convert to dict, list, str, int, float, bool and None; NaN and infinity become None.

    >>> plain({"a": np.float32(0.5), 3: (float("nan"), PurePath("x"))})
    {'a': 0.5, '3': [None, 'x']}
    """
    if value is None or isinstance(value, bool | int | str):
        return value.value if isinstance(value, enum.Enum) else value
    if isinstance(value, np.generic | np.ndarray):
        return plain(cast("object", value.tolist()))
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in cast("list[object]", value)]
    return _plain_object(value)


def _plain_object(value: object) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = dataclasses.fields(value)
        return {field.name: plain(getattr(value, field.name)) for field in fields}
    if isinstance(value, Mapping):
        entries = cast("Mapping[object, object]", value).items()
        return {str(plain(key)): plain(entry) for key, entry in entries}
    return str(value) if isinstance(value, PurePath) else repr(value)
