"""Reads what tools are to draw: files by MCAP's own reader, and schemas as strictly as those tools read them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from jsonschema import Draft202012Validator
from mcap.reader import make_reader

NEGATIVE = {"false", "currently_false"}


class Read(NamedTuple):
    """A message as it was read."""

    topic: str
    schema: str
    time: int
    published: int
    data: dict[str, Any]


def fields(schema: dict[str, Any], path: str = "") -> dict[str, str]:
    """The paths of a schema that can be plotted, with their types, as Foxglove's reader of JSON Schema takes them.

    It takes one type a field: an object's, an array's of one type of items, or a plain one; and choices of numbers.
    """
    assert schema["type"] == "object", path
    found = {}
    for name, field in schema["properties"].items():
        here = f"{path}.{name}"
        if "oneOf" in field:
            assert all(isinstance(choice["const"], int) and choice["title"] for choice in field["oneOf"])
            found[here] = "integer"
        elif field["type"] == "object":
            found |= fields(field, here)
        elif field["type"] == "array":
            items = field["items"]
            found |= fields(items, f"{here}[:]") if items["type"] == "object" else {f"{here}[:]": items["type"]}
        else:
            assert field["type"] in ("number", "integer", "string", "boolean"), here
            found[here] = field["type"]
    return found


def read(path: Path) -> tuple[list[Read], dict[str, dict[str, str]]]:
    """All messages by their time, each of which keeps to its schema; and the fields of each channel, by its name."""
    messages: list[Read] = []
    shapes: dict[str, dict[str, str]] = {}
    schemas: dict[str, dict[str, Any]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            content = schemas.setdefault(schema.name, json.loads(schema.data))
            assert content == json.loads(schema.data), "a name stands for one schema"
            shapes.setdefault(channel.topic, fields(content))
            data = json.loads(message.data)
            Draft202012Validator(content).validate(data)
            messages.append(Read(channel.topic, schema.name, message.log_time, message.publish_time, data))
    return messages, shapes


def drawn(records: Iterable[dict[str, Any]]) -> list[tuple[Any, ...]]:
    """What is to be drawn of one property in one order: each change, each violation, the first record and the last."""
    told, before, last = [], None, None
    for record in records:
        now = record["outcome"], record["degraded"], record["robustness"]
        if now != before or record["violation"]:
            told.append(record)
        before, last = now, record
    if last is not None and told[-1] is not last:
        told.append(last)
    return [(r["n"], r["outcome"], r["violation"], r["degraded"], r["judged"], r["stamp"]) for r in told]
