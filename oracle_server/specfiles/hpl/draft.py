"""A property of HPL on its way to a pattern: its signals, which are called as HPL says them, and its variables."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field

from oracle_server.core.kinds import RESERVED
from oracle_server.specfiles.hpl.tree import Expr, Property

Signals = dict[str, dict[str, str]]
"""For each topic the signals by their names, as expressions."""
_PLAIN = re.compile(
    r"(?!(and|or|not|implies|pre|once|historically|since|until|eventually|always|next|lasting|first|exists|forall|true"
    r"|false|inf)$)([a-z_]\w*|[A-Z]\w+)",
    re.ASCII,
)
_LONGEST_NAME = 100


@dataclass(slots=True)
class Draft:
    """A property on its way to a pattern; `signals` are those that are there, with what it adds, `used` its own."""

    prop: Property
    source: str
    signals: Signals
    variables: dict[tuple[str, str], str] = field(default_factory=dict)
    bound: dict[str, list[str]] = field(default_factory=dict)
    """By its alias, what an event binds."""
    constraints: dict[int, list[str]] = field(default_factory=dict)
    """By its place, what an event must meet."""
    used: Signals = field(default_factory=dict)


def signal(draft: Draft, topic: str, name: str, text: str) -> str:
    """The name of the signal of a topic that is an expression; it is called as HPL says it."""
    known = draft.signals.setdefault(topic, {})
    plain = "".join(c if c.isprintable() and c != "\\" else "?" for c in name.replace('"', "'"))
    plain = f"msg.{plain}" if plain in RESERVED or plain == "todo" else plain
    plain = plain if len(plain) <= _LONGEST_NAME else f"{plain[:_LONGEST_NAME]}..."
    called, number = plain, 1
    while known.get(called, text) != text:
        number += 1
        called = f"{plain} ({number})"
    known[called] = draft.used.setdefault(topic, {})[called] = text
    return called


def key(name: str) -> str:
    """A signal's name as the key of an atom: bare where it is a word, and none of a formula's own."""
    return name if _PLAIN.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def text_of(draft: Draft, expr: Expr) -> str:
    """An expression as it stands in the text."""
    return " ".join(draft.source[expr.at : expr.end].split())
