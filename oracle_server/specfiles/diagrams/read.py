"""State diagrams: their states, where they begin, and their arrows."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import NoReturn

from oracle_server.core.errors import OracleError

MOST = 256 * 1024
"""Characters of a diagram."""
_HEADER = re.compile(r"stateDiagram(?:-v2)?\b")
_ID = r"(?:(?!->)[^\s:])+"
_CLASS = f"(?::::{_ID})?"
_LABEL = r"(?::(?!:)\s*(?P<label>(?:(?!-->).)*))?"
_ARROW = re.compile(rf"(?P<one>{_ID}){_CLASS}\s*-->\s*(?P<other>{_ID}){_CLASS}\s*{_LABEL}")
_COMMENT = re.compile(r"(?:^|\s)%%.*")
_PASSED = re.compile(r"(?:direction|classDef|class|style|hide|scale)\s+[^\s:]|---$")
_STATE = re.compile(rf'state\s+(?:"[^"]*"\s+as\s+)?(?P<name>[^\s:]+){_CLASS}\s*(?P<rest>.*)')
_DESCRIBED = re.compile(rf"(?P<name>{_ID}){_CLASS}\s*(?::.*)?")
_NOTE = re.compile(r"note\s+(?:left|right)\s+of\s+[^\s:]+\s*(?P<text>:.*)?|acc(?:Title|Descr)\s*(?P<told>:.*)")
_TOKEN = re.compile(
    r'\s+|//[^\n]*|/\*.*?(?:\*/|\Z)|(?m:^#[^\n]*)|(?P<text>"(?:\\.|[^"\\])*(?:"|\Z))|(?P<sign>->|--|[{}\[\];:,=])|(?P<name>[^\s{}\[\];:,="]+?(?=->|--|[\s{}\[\];:,="]|$))|(?P<odd>.)',
    re.DOTALL,
)


class DiagramError(OracleError):
    """A diagram that can't be read, with its place."""


@dataclass(frozen=True, slots=True)
class Arrow:
    """A transition, and the line in which it stands; its label is empty where it has none."""

    state: str
    to: str
    label: str
    line: int


_FINAL = "\n"
"""Where an arrow to the end leads until all states are known: no state is called so."""


@dataclass(slots=True)
class Diagram:
    """A state diagram; `start` is empty where none is drawn."""

    start: str = ""
    states: dict[str, None] = field(default_factory=dict)
    arrows: list[Arrow] = field(default_factory=list)


def read_diagram(path: Path) -> Diagram:
    """Read a state diagram of mermaid, or a digraph of DOT. Raises `DiagramError`."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no UTF-8 text"
        raise DiagramError(f"{path}: can't be read: {reason}") from None
    if len(text) > MOST:
        raise DiagramError(f"{path}: {len(text):,} characters; at most {MOST:,} are read")
    dot = _Dot(path, text)
    found = dot.read() if dot.begins() else _mermaid(path, text)
    if not found.arrows:
        raise DiagramError(f"{path}: no arrow between states is in it: expected `A --> B: event`, or `A -> B`")
    _name_final(found)
    return found


def _mermaid(path: Path, text: str) -> Diagram:
    found = Diagram()
    begun, noted = False, 0
    for number, written in enumerate(text.splitlines(), 1):
        line = _COMMENT.sub("", written).strip().rstrip("; ")
        if noted:
            noted = 0 if line == "end note" else noted
        elif not begun:
            begun = _HEADER.match(line) is not None
        elif line.startswith("```"):
            break
        elif line:
            noted = number if _line(path, number, line, found) else 0
    if not begun:
        raise DiagramError(f"{path}: no state diagram: mermaid's begins with `stateDiagram-v2`, DOT's with `digraph`")
    if noted:
        _refuse(path, noted, "this note has no end: expected `end note` in a line below it, or `: text` in its own")
    return found


def _line(path: Path, number: int, line: str, found: Diagram) -> bool:
    """Read a line; returns whether a note of several lines begins."""
    note = _NOTE.fullmatch(line)
    if note:
        return not (note["text"] or note["told"])
    arrow = _ARROW.fullmatch(line)
    if arrow and not arrow["one"] == arrow["other"] == "[*]":
        one, other, label = arrow["one"], arrow["other"], (arrow["label"] or "").strip()
        if one == "[*]":
            _begin(path, number, other, found)
        elif other != "[*]":
            _add(found, Arrow(one, other, label, number))
        else:
            _finish(found, Arrow(one, _FINAL, label, number))
        return False
    if "-->" in line:
        expected = "write `A --> B: event`, one arrow a line, with names of states without spaces"
        _refuse(path, number, f"`{line[:60]}` is not understood as an arrow: {expected}")
    if _PASSED.match(line):
        return False
    state = _STATE.fullmatch(line)
    described = _DESCRIBED.fullmatch(line)
    if state and not state["rest"]:
        found.states.setdefault(state["name"])
    elif line in ("--", "}") or state:
        _refuse(path, number, "states within states, choices and forks are not taken: draw one machine a file")
    elif not described:
        _refuse(path, number, f"`{line[:60]}` is not understood: expected `A --> B: event`")
    else:
        found.states.setdefault(described["name"])
    return False


class _Dot:
    """Reads a digraph of DOT."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.tokens: list[tuple[str, str, int]] = []
        line = 1
        for match in _TOKEN.finditer(text):
            if match.lastgroup in ("text", "sign", "name", "odd"):
                self.tokens.append((match.lastgroup, match[0], line))
            line += match[0].count("\n")
        self.at = 0
        self.points: set[str] = set()
        self.found = Diagram()

    def begins(self) -> bool:
        """Whether it is a graph, behind what may stand before one; the place is then that of `graph` or `digraph`."""
        while self._text.startswith("```") or self._text.lower() == "strict":
            self.at += 1
        following = [text for _, text, _ in self.tokens[self.at + 1 : self.at + 3]]
        return self._text.lower() in ("graph", "digraph") and "{" in following

    def read(self) -> Diagram:
        """The diagram, from where it begins."""
        if self._text.lower() == "graph":
            self._refuse("a `graph` has no directions: write `digraph`, with `->`")
        while self._text not in ("{", ""):
            self.at += 1
        self.at += 1
        while self._text not in ("}", ""):
            self._statement()
        if not self._text:
            self._refuse("a `}` is missing")
        arrows, self.found.arrows = self.found.arrows, []
        for arrow in arrows:
            if arrow.state in self.points:
                _begin(self.path, arrow.line, arrow.to, self.found)
            elif arrow.to not in self.points:
                _add(self.found, arrow)
            else:
                _finish(self.found, replace(arrow, to=_FINAL))
        for point in self.points:
            self.found.states.pop(point, None)
        return self.found

    @property
    def _text(self) -> str:
        return self.tokens[self.at][1] if self.at < len(self.tokens) else ""

    def _statement(self) -> None:
        if self._text in (";", ","):
            self.at += 1
            return
        if self._text == "{" or self._text.lower() == "subgraph":
            self._refuse("graphs within graphs are not taken: draw one machine a file")
        names, line = [self._state()], self.tokens[self.at - 1][2]
        if self._text == "=":  # an attribute of the graph
            self.at += 1
            self._value()
            return
        while self._text in ("->", "--"):
            if self._text == "--":
                self._refuse("an arrow of a digraph is `->`")
            self.at += 1
            names.append(self._state())
        attributes = self._attributes()
        if len(names) == 1:
            if names[0].lower() not in ("graph", "node", "edge"):
                self.found.states.setdefault(names[0])
                if attributes.get("shape") in ("point", "none", "plaintext"):
                    self.points.add(names[0])
            return
        for one, other in pairwise(names):
            self.found.arrows.append(Arrow(one, other, attributes.get("label", ""), line))

    def _attributes(self) -> dict[str, str]:
        found: dict[str, str] = {}
        while self._text == "[":
            self.at += 1
            while self._text not in ("]", ""):
                key = self._name()
                if self._text == "=":
                    self.at += 1
                    found[key.lower()] = self._value()
                if self._text in (",", ";"):
                    self.at += 1
            self.at += 1
        return found

    def _state(self) -> str:
        name = self._name()
        while self._text == ":":  # a port, which is about the drawing alone
            self.at += 1
            self._name()
        return name

    def _value(self) -> str:
        if self._text.startswith("<"):
            self._refuse('a label in HTML is not read: write it in quotes, as `label="go"`')
        return self._name()

    def _name(self) -> str:
        kind, text, _ = self.tokens[self.at] if self.at < len(self.tokens) else ("", "", 0)
        if kind not in ("text", "name"):
            self._refuse(f"`{text}` is not expected here" if text else "the diagram ends in the midst of a statement")
        self.at += 1
        return " ".join(re.sub(r'\\(["\\])', r"\1", text[1:-1]).split()) if kind == "text" else text

    def _refuse(self, message: str) -> NoReturn:
        at = min(self.at, len(self.tokens) - 1)
        _refuse(self.path, self.tokens[at][2] if self.tokens else 1, message)


def _begin(path: Path, line: int, state: str, found: Diagram) -> None:
    if found.start not in ("", state):
        _refuse(path, line, f"it begins in `{found.start}` already: draw one machine a file")
    found.start = state
    found.states.setdefault(state)


def _add(found: Diagram, arrow: Arrow) -> None:
    found.states.setdefault(arrow.state)
    found.states.setdefault(arrow.to)
    found.arrows.append(arrow)


def _finish(found: Diagram, arrow: Arrow) -> None:
    """An arrow to the end: what has a label is an event, and must lead somewhere."""
    found.states.setdefault(arrow.state)
    if arrow.label:
        found.arrows.append(arrow)


def _name_final(found: Diagram) -> None:
    """Give the state to which the arrows to the end lead a name that is not taken."""
    if not any(arrow.to == _FINAL for arrow in found.arrows):
        return
    name, number = "end", 1
    while name in found.states:
        number += 1
        name = f"end_{number}"
    found.arrows = [replace(arrow, to=name) if arrow.to == _FINAL else arrow for arrow in found.arrows]
    found.states[name] = None


def _refuse(path: Path, line: int, message: str) -> NoReturn:
    raise DiagramError(f"{path}:{line}: {message}")
