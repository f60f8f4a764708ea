"""The pages that are made from what the code says: the commands, the HTTP API, and the messages of adapters."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

import schemas

Document = Mapping[str, Any]

HTTP = """# HTTP

The API of version {version}, as a running server shows it at `/docs` and sends it from `/openapi.json`; the document
is [openapi.json](openapi.json). Times are in nanoseconds since the epoch. With [tokens](security.md) a request carries
the header `Authorization: Bearer TOKEN`. What can't be answered is a [problem](#problem), with its reason in `detail`.
"""
WIRE = """# Between adapter and server

An adapter speaks JSON over a WebSocket, at `/api/v1/attach`, a message a frame. The JSON Schema is
[wire.schema.json](wire.schema.json). How messages follow each other is in
[an adapter of your own](adapters.md#an-adapter-of-your-own), with conversations to test one by.
"""


def pages(root: Path) -> dict[str, str]:
    """Each page by its name in docs/."""
    command = [sys.executable, str(root / "scripts" / "manual"), "--markdown"]
    made = subprocess.run(command, check=True, capture_output=True, cwd=root, encoding="utf-8")
    http, wire = (
        json.loads((root / "docs" / name).read_text(encoding="utf-8")) for name in ("openapi.json", "wire.schema.json")
    )
    return {
        "cli.md": made.stdout,
        "http.md": "\n".join(http_page(http)),
        "wire.md": "\n".join(wire_page(wire)),
    }


def http_page(document: Document) -> Iterator[str]:
    """The lines of the page on the API: what can be asked, group by group, and the forms of what is sent."""
    yield HTTP.format(version=document["info"]["version"])
    asked = [(path, method, each) for path, methods in document["paths"].items() for method, each in methods.items()]
    for tag, group in groupby(sorted(asked, key=lambda item: item[2]["tags"][0]), key=lambda item: item[2]["tags"][0]):
        yield f"\n## {tag.capitalize()}\n"
        for path, method, each in group:
            yield f"### {method.upper()} {path}\n"
            yield each["description"] + "\n"
            yield from parameters(each)
    yield "## Forms\n"
    for name, schema in document["components"]["schemas"].items():
        yield from schemas.told(name, schema)


def parameters(asked: Document) -> Iterator[str]:
    """A table of what a request has, and a line for what it takes and what answers it."""
    if asked.get("parameters"):
        yield "| | | |\n| --- | --- | --- |"
        for each in asked["parameters"]:
            yield schemas.row(each["name"], each["schema"], required=each["required"], place=each["in"])
        yield ""
    if "requestBody" in asked:
        yield f"It takes {formats(asked['requestBody'])}.\n"
    for status, answer in asked["responses"].items():
        if status.startswith("2"):
            yield f"`{status}` answers with {formats(answer)}.\n"


def formats(body: Document) -> str:
    """What a request or an answer consists of, by its types."""
    told = [
        f"{schemas.kind(each.get('schema', {}))} as `{name}`" if each.get("schema") else f"`{name}`"
        for name, each in body.get("content", {}).items()
    ]
    return " or ".join(told) or "nothing"


def wire_page(document: Document) -> Iterator[str]:
    """The lines of the page on the messages: who sends which, and the form of each."""
    definitions = dict(document["$defs"])
    yield WIRE
    for name, who in (("from_monitor", "An adapter sends"), ("from_server", "The server sends")):
        sent = definitions.pop(name)["discriminator"]["mapping"]
        yield f"## {who}\n\n| `type` | |\n| --- | --- |"
        for word, place in sent.items():
            form = place.rsplit("/", 1)[-1]
            yield f"| `{word}` | {schemas.link(form)}: {schemas.cell(definitions[form].get('description', ''))} |"
        yield ""
    yield "## Forms\n"
    for name, schema in definitions.items():
        yield from schemas.told(name, schema)
