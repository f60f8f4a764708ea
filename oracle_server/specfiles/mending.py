"""What to write for a value of another kind than a key takes, as far as that can be told from the value."""

from __future__ import annotations

import re
from typing import Any

from oracle_server.core.kinds import GROUPS
from oracle_server.core.nearest import near
from oracle_server.specfiles.document import Document, KeyPath
from oracle_server.specfiles.sentences import SAYS


def mend(document: Document, path: KeyPath, value: object) -> str:
    """What follows the refusal of a value: a sentence that begins with its separator, or nothing."""
    key = "formula" if len(path) > 1 and path[0] == "define" else path[-1]
    if isinstance(value, str):
        return _of_text(document, path, value)
    if isinstance(value, list):
        return _signals_mend(value) if key == "signals" else "; write one `- topic:` for each" if key == "topic" else ""
    if is_map(value):
        if key in SAYS:
            return f", since YAML reads `{{` itself; put the {key} in quotes"
        return "; put `- ` before each of them" if key in ("streams", "properties") else ""
    if isinstance(value, bool | int | float) and key in ("id", "description", *SAYS):
        quoted = str(value).lower() if isinstance(value, bool) else str(value)
        return f'; put it in quotes: "{quoted}"'
    return ""


def _of_text(document: Document, path: KeyPath, value: str) -> str:
    match path[-1]:
        case "hold" | "guards" | "causes" | "streams" | "ask":
            return f"; write [{_meant(document, path, value)}]"
        case "ordered" | "latch":
            truth = {"yes": "true", "on": "true", "no": "false", "off": "false"}.get(value.lower(), value.lower())
            return f"; write {truth}" if truth in ("true", "false") else ""
        case "type":
            return _type_mend(value)
        case "topic" | "service" | "ros_action" | "proxy" if re.search(r"[^\w/~{}]", value):
            return "; names have letters, digits, `_` and `/`, and nothing else"
        case "id":
            return f", which has {len(value)} characters" if len(value) > 64 else _other_id(value)
    return ""


def _meant(document: Document, path: KeyPath, name: str) -> str:
    """The stream, or under `hold` the signal, that a name means; the name where it is one, or like none."""
    known = at(document.value, (*path[:-1], "signals")) if path[-1] == "hold" else _stream_names(document)
    return name if not known or name in known else next(iter(near(name, map(str, known))), name)


def _stream_names(document: Document) -> list[str]:
    streams = at(document.value, ("streams",))
    found = [s.get(group) for s in streams if is_map(s) for group in GROUPS] if isinstance(streams, list) else []
    return [name for name in found if isinstance(name, str)]


def _other_id(value: str) -> str:
    other = re.sub(r"[\s/]+", "_", value.strip(" /\n"))
    return f"; write {other}" if re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*", other) else ""


def _signals_mend(value: list[Any]) -> str:
    first: Any = value[0] if value else None
    if isinstance(first, str):
        return f"; write {{{first}: msg.{first}}}"
    if is_map(first) and len(first) == 1:
        return "; leave the `- ` out"
    if is_map(first) and isinstance(first.get("name"), str):
        other = next((text for key, text in first.items() if key != "name"), "msg.data")
        return f"; write {{{first['name']}: {other}}}"
    return ""


def _type_mend(value: str) -> str:
    plain = re.sub(r"\.(msg|srv)$", "", value.replace("::", "/"))
    if plain != value and re.fullmatch(r"\w+/((msg|srv)/)?\w+", plain):
        return f"; write {plain}"
    if "/srv/" in value or "/action/" in value or "/msg/" in value:
        kind = "a service" if "/srv/" in value else "an action" if "/action/" in value else "a topic"
        return f", which is the type of {kind}"
    return f"; write it with its package, as std_msgs/msg/{value}" if re.fullmatch(r"\w+", value) else ""


def at(value: Any, path: KeyPath) -> Any:
    """What stands at a path of a document's value, None where nothing does."""
    for part in path:
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            return None
    return value


def is_map(value: object) -> bool:
    """Whether a value is a mapping."""
    return isinstance(value, dict)
