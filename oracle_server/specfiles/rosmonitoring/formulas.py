"""Reads the formulas of property modules: Rye as reelay reads it, with bare names, and what LTL says of the past."""

from __future__ import annotations

import re
from collections.abc import Callable

from oracle_server.core.errors import FormulaError, OracleError, one_line
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.tree import (
    TRUE,
    And,
    Atom,
    Bound,
    Exists,
    Forall,
    Formula,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Pre,
    Relation,
    Signal,
    Since,
    walk,
)

_WORDS = frozenset({"historically", "once", "since", "pre", "and", "or", "not", "implies", "exists", "forall", "inf"})
_PAST = {"H": "historically", "O": "once", "P": "once", "Y": "pre", "S": "since"}
_FUTURE = re.compile(r"(?<![\w'\"])(F|U|X|W|R|V|M)(?![\w'\"])|<>|\[\]")
_PREFIX = r"(?:not\b|!|historically\b|once\b|pre\b|[HPY](?=\s*[\[({]))"
_SIDE_BY_SIDE = re.compile(rf"{_PREFIX}(?:\s*\[[^\]]*\])?\s*{_PREFIX}")
_NAME = re.compile(r"\b[A-Za-z_]\w*\b")


class FutureError(OracleError):
    """A formula about what comes, which is judged elsewhere."""


class UnreadableFormulaError(OracleError):
    """A formula that can't be read, or that reelay reads in another way than it is written."""


def read_formula(text: str) -> Formula:
    """A module's formula. Raises `FutureError` or `UnreadableFormulaError`."""
    if "{" in text and _misread(text):
        raise UnreadableFormulaError(
            "reelay reads this only in part: it wants parentheses around an operator's operand"
        )
    text = _braced(text) if "{" not in text else re.sub(r"\bO(?=\s*[\[({])", "once", text)
    try:
        formula = parse_formula(text, "steps")
    except FormulaError as error:
        raise UnreadableFormulaError(f"the formula can't be read ({one_line(str(error))})") from None
    for node in walk(formula):
        if node == TRUE:
            raise UnreadableFormulaError("reelay has no `true`, `false` and `first`")
        if isinstance(node, Atom) and any(isinstance(c.value, Signal) for c in node.constraints):
            raise UnreadableFormulaError("reelay compares with numbers alone")
        if isinstance(node, Relation):
            raise UnreadableFormulaError("reelay does not compare variables")
        if isinstance(node, Once | Historically | Since) and node.bound == Bound(0, 0):
            raise UnreadableFormulaError("reelay takes the bound [0:0] for no bound at all")
    return formula


def changed(node: Formula, change: Callable[[Atom], Formula]) -> Formula:  # noqa: C901, PLR0911 -- a case a node
    """The formula with each atom changed."""
    match node:
        case Atom():
            return change(node)
        case Not(operand):
            found = changed(operand, change)
            return found.operand if isinstance(found, Not) else Not(found)
        case Pre(operand):
            return Pre(changed(operand, change))
        case Once(operand, bound):
            return Once(changed(operand, change), bound)
        case Historically(operand, bound):
            return Historically(changed(operand, change), bound)
        case Since(left, right, bound):
            return Since(changed(left, change), changed(right, change), bound)
        case And(left, right):
            return And(changed(left, change), changed(right, change))
        case Or(left, right):
            return Or(changed(left, change), changed(right, change))
        case Implies(left, right):
            return Implies(changed(left, change), changed(right, change))
        case Exists(variable, body, at):
            return Exists(variable, changed(body, change), at)
        case Forall(variable, body, at):
            return Forall(variable, changed(body, change), at)
        case _:
            raise AssertionError(node)  # see `read`


def _misread(text: str) -> bool:
    """Whether reelay stops in the middle: at two operators side by side, and at a second `->` or `since` in a row."""
    if _SIDE_BY_SIDE.search(text):
        return True
    for word in (r"->|\bimplies\b", r"\bsince\b"):
        counts = [0]
        for mark in re.findall(rf"{word}|[()]|\b(?:and|or)\b|&&|\|\|", text):
            if mark == "(":
                counts.append(0)
            elif mark == ")":
                counts = counts[:-1] or [0]
            elif re.fullmatch(word, mark):
                counts[-1] += 1
                if counts[-1] > 1:
                    return True
            elif "since" in word:
                counts[-1] = 0
    return False


def _braced(text: str) -> str:
    """A formula whose atoms are bare names: of an older reelay, or LTL, of which `G` of the present is of the past."""
    text = re.sub(r"\bAND\b", "and", text)
    text = re.sub(r"\bOR\b", "or", text)
    text = re.sub(r"\bNOT\b", "not", text)
    text = re.sub(r"\bIMPLIES\b|=>", "->", text)
    if re.search(r"(?<!\w)G(?!\w)", text) or _FUTURE.search(text):
        text = " and ".join(_globally(part) for part in _parts(text))
    return _NAME.sub(lambda m: m[0] if m[0] in _WORDS else _PAST.get(m[0]) or f"{{{m[0]}}}", text)


def _globally(part: str) -> str:
    part = part.strip()
    while part.startswith("(") and _closing(part) == len(part) - 1:
        part = part[1:-1].strip()
    found = re.fullmatch(r"G\s*(.*)", part)
    rest = found[1].replace(" ", "").lstrip("!") if found else ""
    alone = re.fullmatch(r"\w+", rest) or (rest.startswith("(") and _closing(rest) == len(rest) - 1)
    if not found or not alone or _FUTURE.search(found[1]) or re.search(r"(?<!\w)(G|H|O|P|Y|S)(?!\w)", found[1]):
        raise FutureError("a formula of LTL about what comes")
    return f"historically {found[1]}"


def _parts(text: str) -> list[str]:
    """The operands of a conjunction; the text alone where it is none."""
    parts, depth, start, i = [], 0, 0, 0
    while i < len(text):
        depth += (text[i] == "(") - (text[i] == ")")
        found = re.compile(r"and\b|&&|&").match(text, i) if depth == 0 else None
        if found and (i == 0 or not text[i - 1].isalnum() or text[i] == "&"):
            parts.append(text[start:i])
            start = i = found.end()
        else:
            i += 1
    return [*parts, text[start:]]


def _closing(text: str) -> int:
    depth = 0
    for i, mark in enumerate(text):
        depth += (mark == "(") - (mark == ")")
        if depth == 0:
            return i
    return -1
