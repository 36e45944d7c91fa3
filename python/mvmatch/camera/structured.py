"""YAML and JSON as plain data, whoever wrote them."""

# PyYAML types its loader only in part.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, cast

import yaml

from mvmatch.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Hashable
    from pathlib import Path

_OPENCV_TAGS = "tag:yaml.org,2002:opencv-"


class _PlainLoader(yaml.SafeLoader):
    """PyYAML's safe loader with OpenCV's tags and without references, which can multiply."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("it has references (*), which are not read here")
        return super().compose_node(parent, index)


def _fields(loader: yaml.SafeLoader, _: str, node: yaml.Node) -> dict[Hashable, Any]:
    if not isinstance(node, yaml.MappingNode):
        raise yaml.YAMLError("an OpenCV tag is not followed by fields")
    return loader.construct_mapping(node, deep=True)


_PlainLoader.add_multi_constructor(_OPENCV_TAGS, _fields)


def read_mapping(path: Path, text: str) -> dict[str, Any] | None:
    """Return the fields of a YAML or JSON file; None when it does not look like one.

    No object is ever made of them: tags other than OpenCV's, references and nesting without end are
    refused.

    Raises
    ------
    DataError
        It looks like one, and is broken.
    """
    start = text.lstrip()[:5]
    if start.startswith("{"):
        return _plain(path, _load_json(path, text))
    if start == "%YAML" or path.suffix.lower() in {".yaml", ".yml"}:
        return _plain(path, _load_yaml(path, text))
    return None


def _load_json(path: Path, text: str) -> object:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(f"camera file {path} is not valid JSON: {_reason(error)}") from error


def _load_yaml(path: Path, text: str) -> object:
    # OpenCV's first line, "%YAML:1.0", is no YAML.
    lines = ["" if line.startswith("%YAML") else line for line in text.splitlines()[:1]]
    body = "\n".join([*lines, *text.splitlines()[1:]])
    try:
        return yaml.load(body, Loader=_PlainLoader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise DataError(f"camera file {path} cannot be read as YAML: {_reason(error)}") from error


def _plain(path: Path, data: object) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise DataError(f"camera file {path} holds no fields with names, so no camera")
    return {str(key): value for key, value in cast("dict[object, Any]", data).items()}


def _reason(error: Exception) -> str:
    """Return an error in one line."""
    if isinstance(error, RecursionError):
        return "nested too deeply"
    return " ".join(str(error).split())[:200]
