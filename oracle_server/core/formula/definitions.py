"""What stands under `define:`: names, with variables or without, each with a formula."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.around import WORDS
from oracle_server.core.formula.names import Named, Names
from oracle_server.core.formula.parse import check_variables, read_part
from oracle_server.core.formula.tree import Call, Formula, Time

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
_HEAD = re.compile(rf"\s*({_NAME})\s*(?:\(\s*({_NAME}(?:\s*,\s*{_NAME})*)\s*\)\s*)?", re.ASCII)
_TAKEN = WORDS | {"eventually", "always", "until", "next"}
"""Words that are operators of formulas."""
_CLOCKS: tuple[Time, ...] = ("seconds", "steps")


class Mistake(NamedTuple):
    """What is wrong with a definition: of its name where `in_text` is false, else at a place in its formula."""

    head: str
    error: FormulaError
    in_text: bool


def defined(definitions: Mapping[str, str | None], mistakes: list[Mistake]) -> Names:
    """The names that are defined; what is wrong with them is added to `mistakes`.

    Of those that have no text something was said already.
    """
    names = Names()
    heads = {head: _call(head) for head in definitions}
    for place, (head, text) in enumerate(definitions.items()):
        call = heads[head]
        reason = call if isinstance(call, str) else _clash(call, names)
        if isinstance(call, str) or reason:
            mistakes.append(Mistake(head, FormulaError(reason), in_text=False))
            continue
        names.reading = call.name
        names.below = frozenset(c.name for c in [*heads.values()][place + 1 :] if isinstance(c, Call))
        bodies = {time: _body(text, time, call, names) for time in _CLOCKS}
        names.known[call.name] = Named(head, call, bodies)
        errors = [body for body in bodies.values() if isinstance(body, FormulaError)]
        if len(errors) == len(_CLOCKS) and not errors[0].told:
            mistakes.append(Mistake(head, errors[0], in_text=True))
    names.reading, names.below = "", frozenset()
    return names


def _call(head: str) -> Call | str:
    """The name and its variables, or why these can't be read."""
    match = _HEAD.fullmatch(head)
    if match is None:
        return f"'{head}' is no name: it has letters, digits and `_`, and its variables in parentheses, as `at(r)`"
    variables = tuple(v.strip() for v in match[2].split(",")) if match[2] else ()
    if match[1] in _TAKEN:
        return f"`{match[1]}` is an operator of formulas; give yours another name"
    doubled = next((v for i, v in enumerate(variables) if v in variables[:i]), None)
    if doubled is not None:
        return f"the variable `{doubled}` of `{match[1]}` stands there twice"
    return Call(match[1], variables)


def _clash(call: Call, names: Names) -> str:
    if call.name not in names.known:
        return ""
    return f"`{call.name}` is defined above, as `{names.known[call.name].call}`; give one of them another name"


def _body(text: str | None, time: Time, call: Call, names: Names) -> Formula | FormulaError:
    """What a name stands for with a clock, or why it can't be read."""
    if text is None:
        return FormulaError("it is no text", told=True)
    try:
        body = read_part(text, time, names)
        free = check_variables(body, frozenset(call.arguments), call)
    except FormulaError as error:
        return error
    unused = next((v for v in call.arguments if v not in free), None)
    if unused is None:
        return body
    return FormulaError(f"the variable '{unused}' of `{call}` is used nowhere: use it as `{{id: *{unused}}}`")
