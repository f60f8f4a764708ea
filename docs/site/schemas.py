"""JSON Schemas as Markdown: each form as a heading, with a table of its fields."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

Schema = Mapping[str, Any]

WORDS = {"array": "list", "string": "text", "boolean": "true or false"} | {
    each: each for each in ("integer", "number", "null", "object")
}


def told(name: str, schema: Schema) -> Iterator[str]:
    """The lines on one form: what it is for, and its fields."""
    yield f"### {name}\n"
    if "description" in schema:
        yield f"{schema['description']}\n"
    if "enum" in schema:
        yield f"{kind(schema)}\n"
    if schema.get("properties"):
        yield "| | | |\n| --- | --- | --- |"
        for field, each in schema["properties"].items():
            yield row(field, each, required=field in schema.get("required", ()))
        yield ""


def row(name: str, schema: Schema, *, required: bool, place: str = "") -> str:
    """A field or a parameter as a row: its name, of what kind it is, and what is to be known of it."""
    inner: Schema = next((each for each in schema.get("anyOf", ()) if "description" in each), {})
    notes = [schema.get("description", inner.get("description", ""))]
    if place == "header":
        notes.append("A header.")
    default = schema.get("default")
    if required:
        notes.append("Required." if place != "path" else "")
    elif default not in (None, "", [], {}):
        notes.append(f"Default `{json.dumps(default, ensure_ascii=False)}`.")
    return f"| `{name}` | {kind(schema)} | {cell(' '.join(ended(note) for note in notes if note))} |"


def kind(schema: Schema) -> str:
    """Of what kind a value is, in a few words, with a link where it has a form of its own."""
    if "$ref" in schema:
        return link(schema["$ref"].rsplit("/", 1)[-1])
    if "enum" in schema or "const" in schema:
        return ", ".join(f"`{each}`" for each in schema.get("enum", [schema.get("const")]))
    either = schema.get("anyOf", schema.get("oneOf"))
    if either:
        return " or ".join(dict.fromkeys(kind(each) for each in either))
    inner = schema.get("items", schema.get("additionalProperties"))
    word = WORDS.get(schema.get("type", ""), "anything")
    return f"{word} of {kind(inner)}" if inner and isinstance(inner, Mapping) else word


def link(name: str) -> str:
    """The name of a form, which leads to it."""
    return f"[{name}](#{name.lower()})"


def ended(text: str) -> str:
    """A sentence with its full stop."""
    return text if text.endswith((".", "`.")) else f"{text}."


def cell(text: str) -> str:
    """A text in one line, of which a table reads nothing as its own."""
    return " ".join(text.split()).replace("|", "\\|").replace("<", "&lt;")
