"""Formulas and expressions of a spec whose keys are wrong: they are read all the same, so that all errors are told."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from yaml import events

from oracle_server.core.errors import EngineError, ExpressionError, Finding, FormulaError
from oracle_server.core.expression import parse_expression
from oracle_server.engines.table import ENGINES
from oracle_server.specfiles.defining import Definitions
from oracle_server.specfiles.derive import derive_findings
from oracle_server.specfiles.document import Document, KeyPath
from oracle_server.specfiles.sentences import SAYS, Says, read_said
from oracle_server.specfiles.wording import PARTS


def texts_findings(document: Document) -> Iterator[Finding]:
    """What is wrong with the formulas and expressions of a document, as far as they are found in it."""
    value = document.value if isinstance(document.value, dict) else {}
    definitions = Definitions(document)
    yield from definitions.findings()
    for i, prop in enumerate(_list(value.get("properties"))):
        engine = prop.get("engine", "auto")
        time = prop["time"] if prop.get("time") in ("steps", "seconds") else None
        row = ENGINES.get(engine) if isinstance(engine, str) else None
        if row is None or engine == "external":
            continue
        for key in SAYS:
            if key == "machine" or not isinstance(prop.get(key), str):
                continue
            try:
                read_said(document, key, prop[key], engine, time, definitions.names, str(i), {})
            except FormulaError as error:
                if not error.told:
                    yield formula_finding(document, i, prop.get("id", i + 1), error, definitions, key)
            except EngineError:
                pass  # what is not installed is told once the keys are right
    yield from derive_findings(document, value.get("derive"), definitions.names)
    for i, stream in enumerate(_list(value.get("streams"))):
        for half in ((), *((part,) for part in PARTS)):
            channel = stream.get(half[0]) if half else stream
            yield from _expressions(document, ("streams", i, *half), channel)


def formula_finding(
    document: Document,
    index: int,
    name: object,
    error: FormulaError,
    definitions: Definitions,
    key: Says = "formula",
) -> Finding:
    """A formula, or what stands for one, that can't be read, at its place in the file."""
    path, within = ("properties", index, key), (error.line, error.column)
    more = f"{definitions.where(path, within)}{_comment(document, path)}"
    return Finding(document.file, *document.place(path, within), f"{key} of '{name}': {error.message}{more}")


def _expressions(document: Document, path: KeyPath, channel: object) -> Iterator[Finding]:
    known = channel if isinstance(channel, dict) else {}
    signals, text, each = known.get("signals"), known.get("each"), None
    if isinstance(text, str):
        try:
            each = parse_expression(text)
        except ExpressionError as error:
            place = document.place((*path, "each"), (error.line, error.column))
            yield Finding(document.file, *place, f"`each`: {error.message}")
            return
    for name, text in signals.items() if isinstance(signals, dict) else ():
        if not isinstance(text, str):
            continue
        try:
            parse_expression(text, each=each)
        except ExpressionError as error:
            place = document.place((*path, "signals", name), (error.line, error.column))
            yield Finding(document.file, *place, f"signal '{name}': {error.message}")


def _comment(document: Document, path: KeyPath) -> str:
    """A hint where a formula without quotes ends at a `#`, which begins a comment."""
    event = document.values.get(path)
    mark: Any = getattr(event, "end_mark", None)
    if not isinstance(event, events.ScalarEvent) or event.style not in (None, "") or mark is None:
        return ""
    if not re.match(r"\s+#", document.lines[mark.line][mark.column :]):
        return ""
    return f"; ` #` begins a comment: put the {path[-1]} in quotes"


def _list(value: object) -> list[dict[str, Any]]:
    """The mappings of a list; what is none is left as an empty one."""
    return [item if isinstance(item, dict) else {} for item in value] if isinstance(value, list) else []
