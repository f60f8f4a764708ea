"""`define:` in spec files: its names, what is wrong with them, and where they stand."""

from __future__ import annotations

import re
from collections.abc import Iterator

from oracle_server.core.errors import Finding, SpecProblem
from oracle_server.core.formula.definitions import Mistake, defined
from oracle_server.core.kinds import OWN, RESERVED
from oracle_server.core.spec import Spec
from oracle_server.specfiles.document import Document, KeyPath, Position
from oracle_server.specfiles.mending import at

_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)


class Definitions:
    """The names of a spec file, as far as they can be read, whatever else is wrong with it."""

    def __init__(self, document: Document) -> None:
        self._document = document
        value = document.value.get("define") if isinstance(document.value, dict) else None
        given = value if isinstance(value, dict) else {}
        mistakes: list[Mistake] = []
        texts = {head: text if isinstance(text, str) else None for head, text in given.items()}
        self.names = defined(texts, mistakes)
        self._mistakes = mistakes

    def findings(self) -> Iterator[Finding]:
        """What is wrong with them, each at its place."""
        for head, error, in_text in self._mistakes:
            path: KeyPath = ("define", head)
            if in_text:
                within = error.line, error.column
                message = f"definition of '{head}': {error.message}{self.where(path, within)}"
                yield Finding(self._document.file, *self._document.place(path, within), message)
            else:
                yield Finding(self._document.file, *self._document.key_place(path), error.message)

    def unused(self) -> Iterator[SpecProblem]:
        """Warnings of names that nothing uses."""
        for name, named in self.names.known.items():
            if name not in self.names.used:
                message = f"`{name}` is defined here, and no formula uses it"
                yield SpecProblem(("define", named.head), message, severity="warning")

    def clashes(self, spec: Spec) -> Iterator[SpecProblem]:
        """Names that are those of signals, too, so that `{name}` would not be what `name` is."""
        signals: dict[str, tuple[str, KeyPath | None]] = dict.fromkeys(RESERVED, ("a signal of all events", None))
        for i, stream in enumerate(spec.streams):
            for name in OWN[stream.traits.group]:
                signals.setdefault(name, (f"a signal of {stream.key}", None))
            for name in stream.signals or ():
                signals.setdefault(name, (f"a signal of {stream.key}", ("streams", i, "signals", name)))
            for name in stream.hold:
                signals.setdefault(name, (f"a signal of {stream.key}", ("streams", i, "hold")))
        signals |= {d.name: ("a derived signal", ("derive", d.name)) for d in spec.derive}
        for name, named in self.names.known.items():
            if name in signals:
                what, first = signals[name]
                yours = "one of them" if first else "yours"
                message = f"`{name}` is {what}, too: `{{{name}}}` would not be `{name}`; give {yours} another name"
                yield SpecProblem(("define", named.head), message, first=first)

    def numeric(self, spec: Spec) -> Iterator[SpecProblem]:
        """Names in formulas over numbers, which have none: there they are signals that no stream declares."""
        for i, prop in enumerate(spec.properties):
            read = {c.key for atom in prop.atoms for c in atom.constraints} if prop.numeric else set()
            for name in sorted(read & self.names.known.keys()):
                if all(stream.signals is not None and name not in stream.signals for stream in spec.streams):
                    message = (
                        f"formula of '{prop.id}': `{name}` stands under `define`, and a formula with "
                        f"`engine: {prop.engine}` has no names; write it over signals"
                    )
                    yield SpecProblem(("properties", i, "formula"), message)

    def where(self, path: KeyPath, within: Position | None) -> str:
        """The end of a message about a place in a formula: where the name is defined that is used there, if one is."""
        match = _NAME.match(self._rest(path, within))
        named = self.names.known.get(match[0]) if match else None
        if named is None:
            return ""
        line, column = self._document.key_place(("define", named.head))
        return f"; `{named.call.name}` is defined at {self._document.file}:{line}:{column}"

    def _rest(self, path: KeyPath, within: Position | None) -> str:
        """The rest of a line of a text from a place on."""
        value = at(self._document.value, path)
        if not isinstance(value, str) or within is None or path[0] not in ("properties", "define"):
            return ""
        line, column = within
        return "".join(value.split("\n")[line - 1 : line])[column - 1 :]
