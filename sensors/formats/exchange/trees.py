"""The text of other programs' files as plain values: maps, lists, matrices, numbers, text.

OpenCV's own reader comes first: it knows XML, JSON and the YAML that `cv2.FileStorage` writes. What it cannot
read (lists that are not indented, as ROS and PyYAML write them) a common YAML reader may; ``%YAML:1.0``, the
first line of OpenCV's files, and ``!!opencv-matrix`` are known to both.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from alignment.errors import FormatError
from sensors.formats.files import read_bytes
from sensors.formats.text import text_of

_PARSING_ERROR = re.compile(r"\((\d+)\): (.*)'")
_FIRST_LINE = re.compile(r"\A\s*%YAML[: ].*(?:\n|\Z)")
_MATRIX_KEYS = {"rows", "cols", "data"}
_MOST_DEPTH = 50


class _Loader(yaml.SafeLoader):
    """A safe loader that refuses a key that stands twice, and reads numbers such as 1e-5."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """As every loader, but each key once."""
        seen: set[str] = set()
        for key, _ in node.value:
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key.value!r} stands twice", key.start_mark
                )
            seen.add(str(key.value))
        return super().construct_mapping(node, deep=deep)

    def matrix(self, node: yaml.MappingNode) -> dict[Any, Any]:
        """Return a map with rows, cols and data."""
        return self.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _Loader.matrix)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


def yaml_values(path: Path, kind: str) -> Any:
    """Read a YAML file as plain values; `kind` says what it should be, such as "a camera chain".

    Raises
    ------
    FormatError
        When it is missing, or is no YAML (the line is named).
    """
    text = text_of(read_bytes(path, kind))
    try:
        return _yaml(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        seen = " ".join(str(error).split())
        raise FormatError(file=path, expected=f"{kind} in YAML", seen=f"an error: {seen}") from error


def _yaml(text: str) -> Any:
    # The line is kept empty, so that errors name the lines of the file.
    return yaml.load(_FIRST_LINE.sub("\n", text), Loader=_Loader)


def storage_values(path: Path, kind: str) -> dict[str, Any]:
    """Read a map that OpenCV wrote, or that another program wrote for it; matrices become arrays.

    Raises
    ------
    FormatError
        When it is missing, damaged, another kind of file, or has a key twice.
    """
    text = text_of(read_bytes(path, kind))
    storage = cv2.FileStorage()
    try:
        opened = storage.open(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        found = _plain(storage.root(), path, "", 0) if opened else None
    except (cv2.error, SystemError, RecursionError, ValueError) as error:
        if isinstance(error, FormatError):
            raise
        found = _second_reader(text)
        if not isinstance(found, dict):
            # OpenCV reports the line and what is wrong with it among the names of its own sources.
            report = _PARSING_ERROR.search(str(error))
            seen = (
                f"an error in line {report[1]}: {report[2]}" if report else "damage, or another kind of file"
            )
            raise FormatError(file=path, expected=kind, seen=seen) from error
    if not isinstance(found, dict):
        raise FormatError(file=path, expected=kind, seen="another kind of file")
    return found


def _second_reader(text: str) -> Any:
    """Return the values of YAML that OpenCV does not read, or None."""
    try:
        return _arrays(_yaml(text), 0)
    except (yaml.YAMLError, ValueError, RecursionError):
        return None


def _arrays(value: Any, depth: int) -> Any:
    """Return values with each map of rows, cols and data as a matrix."""
    if depth > _MOST_DEPTH:
        raise RecursionError
    if isinstance(value, dict):
        inside = {str(key): _arrays(item, depth + 1) for key, item in value.items()}
        return _matrix(inside) if set(inside) >= _MATRIX_KEYS else inside
    return [_arrays(item, depth + 1) for item in value] if isinstance(value, list) else value


def _matrix(stated: dict[str, Any]) -> Any:
    """Return the matrix that a map of rows, cols and data describes."""
    array = np.asarray(stated["data"], dtype=np.float64)
    return array.reshape(int(stated["rows"]), int(stated["cols"]))


def _plain(node: Any, path: Path, place: str, depth: int) -> Any:
    """Return a node as map, list, matrix, number or text: nodes themselves die with their storage."""
    if depth > _MOST_DEPTH:
        raise RecursionError
    if node.isMap():
        keys = node.keys()
        twice = next((key for key in keys if keys.count(key) > 1), None)
        if twice is not None:
            field = f"{place}.{twice}" if place else twice
            raise FormatError(file=path, field=field, expected="each key once", seen="the key twice")
        if _MATRIX_KEYS | {"dt"} <= set(keys):
            return node.mat()
        inside = {
            key: _plain(node.getNode(key), path, f"{place}.{key}".strip("."), depth + 1) for key in keys
        }
        return _matrix(inside) if set(keys) >= _MATRIX_KEYS else inside
    if node.isSeq():
        return [_plain(node.at(n), path, f"{place}[{n}]", depth + 1) for n in range(node.size())]
    if node.isInt():
        return int(node.real())
    if node.isReal():
        return float(node.real())
    return node.string() if node.isString() else None
