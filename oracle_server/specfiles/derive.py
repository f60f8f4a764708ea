"""The derived signals of a spec file: their formulas and expressions read, and the keys that each needs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from oracle_server.core.derived.definition import MAX_DERIVED, OPS, Definition, Op
from oracle_server.core.errors import ExpressionError, Finding, FormulaError
from oracle_server.core.expression import parse_expression
from oracle_server.core.formula.names import Names
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.nearest import listed
from oracle_server.specfiles.document import Document, Position
from oracle_server.specfiles.machines import MachineError, is_machine, read_machine
from oracle_server.specfiles.model import DeriveModel

_UNREAD = "monitor"
"""What one that can't be read stands for meanwhile: a signal that there is always."""
_WORDS: tuple[Op, ...] = ("expression", *(op for op, traits in OPS.items() if not traits.machine))


def definitions(
    document: Document, models: Mapping[str, DeriveModel], findings: list[Finding], names: Names
) -> list[Definition]:
    """The derived signals, in order, with the `names` of formulas; what is wrong with one is added to `findings`."""
    if len(models) > MAX_DERIVED:
        message = f"there are {len(models):,} derived signals; a spec has at most {MAX_DERIVED:,}: write several specs"
        findings.append(Finding(document.file, *document.key_place(("derive",)), message))
        return []
    return [_definition(document, name, model, findings, names) for name, model in models.items()]


def derive_findings(document: Document, derive: object, names: Names) -> Iterator[Finding]:
    """What is wrong with the formulas and expressions of a document whose keys are wrong, as far as there are any."""
    for name, value in derive.items() if isinstance(derive, dict) else ():
        given = {"expression": value} if isinstance(value, str) else value if isinstance(value, dict) else {}
        for key in _WORDS:
            if isinstance(given.get(key), str):
                yield from _unreadable(document, name, key, given[key], names)


def _definition(document: Document, name: str, model: DeriveModel, findings: list[Finding], names: Names) -> Definition:
    if is_machine(model):
        return _machine(document, name, model, findings, names)
    given: list[tuple[Op, str]] = [(op, text) for op in _WORDS if (text := getattr(model, op)) is not None]
    found = list(_keys(model, [op for op, _ in given])) if len(given) == 1 else [("", _which(given))]
    findings += [
        Finding(document.file, *_place(document, name, key), f"derived signal '{name}': {message}")
        for key, message in found
    ]
    op, text = given[0] if given else ("last", _UNREAD)
    unread = list(_unreadable(document, name, op, text, names)) if len(given) == 1 else []
    findings += unread
    if found or unread:
        return Definition(name, "last", _UNREAD)
    formula = parse_formula(text, names=names) if op != "expression" and OPS[op].formula else None
    over, counted = model.over or (None, False)
    return Definition(name, op, " ".join(text.split()), formula, over, counted, model.by or (), model.forget)


def _machine(document: Document, name: str, model: DeriveModel, findings: list[Finding], names: Names) -> Definition:
    try:
        return read_machine(document, name, model, names)
    except MachineError as error:
        path = ("derive", name, *error.path)
        where = document.key_place(path) if error.at_key else document.place(path, error.within)
        if error.message:
            findings.append(Finding(document.file, *where, f"derived signal '{name}': {error.message}"))
    return Definition(name, "last", _UNREAD)


def _which(given: list[tuple[Op, str]]) -> str:
    if not given:
        return (
            f"it says not what it is: write one of {listed(_WORDS[1:])}, a machine, or an expression alone, as in "
            "`limit - speed`"
        )
    return f"it is one of {listed(op for op, _ in given)}, and not several: give each a name of its own"


def _keys(model: DeriveModel, ops: list[Op]) -> Iterator[tuple[str, str]]:
    """What is wrong with the keys beside the operation: the key, and why."""
    (op,) = ops
    if op == "expression":
        for key in ("over", "by", "forget"):
            if getattr(model, key) is not None:
                yield key, f"an expression takes no `{key}`: it is computed of the signals of a step"
        return
    yield from _several(model, op)
    traits = OPS[op]
    if traits.window and model.over is None:
        count = "" if op == "rate" else ", or `over: 20` for samples"
        yield op, f"`{op}` is taken over a window: write `over: 2s`{count}"
    if not traits.window and model.over is not None:
        yield "over", f"`{op}` has no window; leave `over` out"
    if op == "rate" and model.over is not None and model.over[1]:
        yield "over", "a rate is how many there are a second: write a time, as `over: 2s`"
    if model.forget is None:
        return
    if model.by is None:
        yield "forget", "`forget` is for what is kept `by` a signal; leave it out"
    elif traits.window and model.over is not None and (traits.formula or not model.over[1]):
        yield "forget", "a window forgets by itself what has left it; leave `forget` out"


def _several(model: DeriveModel, op: Op) -> Iterator[tuple[str, str]]:
    if model.by is not None and len(model.by) > 1:
        yield "by", f"`{op}` is kept by one signal: `by: {model.by[0]}`; by several there are machines alone"


def _unreadable(document: Document, name: object, op: Op, text: str, names: Names) -> Iterator[Finding]:
    try:
        if op == "expression":
            parse_expression(text, signals=True)
        elif OPS[op].formula:
            parse_formula(text, names=names)
    except (ExpressionError, FormulaError) as error:
        place = _place(document, name, op, (error.line, error.column))
        yield Finding(document.file, *place, f"derived signal '{name}': {error.message}")


def _place(document: Document, name: Any, key: str, within: Position | None = None) -> Position:
    """Where a key's value stands, or the text of one that is a text alone."""
    path = ("derive", name, key)
    if within is None and path in document.keys:
        return document.keys[path]
    return document.place(path, within) if path in document.values else document.place(path[:2], within)
