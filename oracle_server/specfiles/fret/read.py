"""Reads an export of FRET's requirements, and the file in which Ogma is told where variables come from."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from oracle_server.core.errors import OracleError, one_line

MOST_BYTES = 20_000_000
MOST_REQUIREMENTS = 1_000
NUMBER = r"-?\d{1,15}(?:\.\d{1,15})?"
"""A number as it is taken over."""
FIRST = "FTP"
"""FRET's word for the first point of time, which it lists as a variable of the sentences that say it."""


class FretError(OracleError):
    """A file of FRET's or Ogma's that can't be read, with its place."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """A requirement as FRET exports it: its id, its sentence in FRETish, and why it is asked."""

    id: str
    text: str
    rationale: str


@dataclass(frozen=True, slots=True)
class Source:
    """Where a variable comes from: a topic, its type as `std_msgs/msg/Bool` or empty, and the field or empty."""

    topic: str
    type: str
    field: str


@dataclass(frozen=True, slots=True)
class Export:
    """What FRET has exported: the requirements, and the names of all variables that it tells of.

    `constants` are those of them that are numbers, by their names, as they are written.
    """

    requirements: tuple[Requirement, ...]
    variables: frozenset[str]
    constants: Mapping[str, str]


def read_export(path: Path) -> Export:
    """Read `{"requirements": […], "variables": […]}`, or the list of requirements alone. Raises `FretError`."""
    value = _json(path)
    listed = value.get("requirements") if isinstance(value, dict) else value
    if not isinstance(listed, list):
        raise FretError(f'{path}: no export of FRET: a list of requirements, or an object with "requirements"')
    if len(listed) > MOST_REQUIREMENTS:
        raise FretError(f"{path}: {len(listed):,} requirements; at most {MOST_REQUIREMENTS:,} are read: export fewer")
    names: set[str] = set()
    found = []
    for i, each in enumerate(listed):
        if not isinstance(each, dict):
            raise FretError(f"{path}: requirements[{i}]: an object is expected, with `reqid` and `fulltext`")
        found.append(Requirement(*(_text(path, i, each, key) for key in ("reqid", "fulltext", "rationale"))))
        names.update(name for name in _semantic(each.get("semantics")) if name != FIRST)
    variables: dict[str, set[str]] = {}
    for each in _objects(value.get("variables")) if isinstance(value, dict) else []:
        if isinstance(name := each.get("variable_name"), str):
            variables.setdefault(name, set()).add(_number(each))
    constants = {name: values.pop() for name, values in variables.items() if len(values) == 1 and "" not in values}
    return Export(tuple(found), frozenset(names).union(variables), constants)


def read_sources(path: Path) -> dict[str, list[Source]]:
    """Where each variable comes from, by its name, as Ogma's variable file has it. Raises `FretError`."""
    value = _json(path)
    if not isinstance(value, dict) or not isinstance(value.get("inputs"), list):
        raise FretError(f'{path}: no variable file of Ogma: an object with "inputs" and "topics" is expected')
    types = {each.get("topic"): each.get("type") for each in _objects(value.get("topics")) if _of_ros(each)}
    fields = {each.get("fromType"): each.get("fromField") for each in _objects(value.get("types")) if _of_ros(each)}
    found: dict[str, list[Source]] = {}
    for each in _objects(value["inputs"]):
        sources = found.setdefault(str(each.get("name")), [])
        for connection in filter(_of_ros, _objects(each.get("connections"))):
            topic = connection.get("topic")
            type_ = types.get(topic)
            field = connection.get("field") or fields.get(type_)
            known = type_.replace("::", "/") if isinstance(type_, str) else ""
            sources.append(Source(str(topic), known, field if isinstance(field, str) else ""))
    return found


def _json(path: Path) -> Any:
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise FretError(f"{path}: can't be read: {error.strerror}") from None
    if len(data) > MOST_BYTES:
        raise FretError(f"{path}: more than {MOST_BYTES // 10**6} MB, which is more than is read: export fewer")
    try:
        return json.loads(data.decode("utf-8-sig"))
    except json.JSONDecodeError as error:
        raise FretError(f"{path}:{error.lineno}:{error.colno}: not JSON: {error.msg}") from None
    except UnicodeDecodeError as error:
        raise FretError(f"{path}: not UTF-8: byte {error.start}") from None
    except (RecursionError, ValueError) as error:
        raise FretError(f"{path}: not JSON that can be read: {one_line(str(error))}") from None


def _text(path: Path, i: int, each: dict[str, Any], key: str) -> str:
    value = each.get(key)
    if value is None and key == "rationale":
        return ""
    if isinstance(value, str):
        return value
    if key == "rationale":
        return ""
    raise FretError(f"{path}: requirements[{i}]: `{key}` is missing, or no text")


def _number(variable: dict[str, Any]) -> str:
    """The number that a variable of the model stands for, as `ap_standby_state` for `3.0`; empty where it is none."""
    assigned = variable.get("assignment") if variable.get("idType") == "Internal" else None
    return assigned.strip() if isinstance(assigned, str) and re.fullmatch(NUMBER, assigned.strip(), re.ASCII) else ""


def _semantic(semantics: object) -> Iterator[str]:
    """The names of variables that FRET has found in a sentence: a list, or lists by what they are."""
    variables = semantics.get("variables") if isinstance(semantics, dict) else None
    lists = variables.values() if isinstance(variables, dict) else [variables]
    for names in lists:
        yield from (name for name in (names if isinstance(names, list) else []) if isinstance(name, str))


def _objects(value: object) -> list[dict[str, Any]]:
    return [each for each in value if isinstance(each, dict)] if isinstance(value, list) else []


def _of_ros(each: dict[str, Any]) -> bool:
    """Whether it is about a topic, or a type of one, whose values are texts."""
    scope = each.get("scope", each.get("fromScope"))
    values = (each.get(key, "") for key in ("topic", "type", "fromType"))
    return scope in ("ros/message", "ros/type", "ros") and all(isinstance(value, str) for value in values)
