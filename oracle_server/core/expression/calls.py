"""Calls of functions as closures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from oracle_server.core.expression.cost import ELEMENT, SHOWN_REAL, Frame, charge
from oracle_server.core.expression.functions import OF_NUMBERS, OF_TEXT, ONE, VALUELESS
from oracle_server.core.expression.loops import Run
from oracle_server.core.expression.patterns import compile_pattern
from oracle_server.core.expression.stops import Failed
from oracle_server.core.expression.tree import Call, Literal
from oracle_server.core.expression.values import shown, unfit


def call(node: Call, arguments: list[Run]) -> tuple[Run, bool]:
    """The closure of a call with these arguments, and whether its cost depends on the message."""
    if node.name in VALUELESS:
        return _valueless(VALUELESS[node.name]), False
    if node.name in OF_NUMBERS:
        return _of_numbers(node.name, arguments), len(arguments) == 1
    if len(arguments) == 1:
        return _of_one(node.name, arguments[0])
    first, second = arguments
    part = node.arguments[1]
    if node.name == "matches" and isinstance(part, Literal):
        found_in = compile_pattern(str(part.value)).found_in
        return lambda message, frame: found_in(first(message, frame), frame), True
    varies = node.name == "contains" or not isinstance(part, Literal)
    return _of_texts(node.name, first, second), varies


def _of_numbers(name: str, arguments: list[Run]) -> Run:
    function = OF_NUMBERS[name]
    if len(arguments) > 1:
        return lambda message, frame: function([argument(message, frame) for argument in arguments])
    (first,) = arguments

    def run(message: Mapping[str, Any], frame: Frame) -> Any:
        values = first(message, frame)
        if type(values) is not list:
            raise unfit(f"`{name}` takes several numbers, or a list of numbers", values)
        charge(frame, ELEMENT * len(values))
        return function(values)

    return run


def _valueless(why: str) -> Run:
    def run(_message: Mapping[str, Any], _frame: Frame) -> Any:
        raise Failed(why)

    return run


def _of_one(name: str, first: Run) -> tuple[Run, bool]:
    if name == "string":
        return _string(first), False
    if name in OF_TEXT:
        return _of_text(name, first), True
    function = ONE[name]
    return lambda message, frame: function(first(message, frame)), False


def _of_text(name: str, first: Run) -> Run:
    change, why = OF_TEXT[name], f"`{name}` takes a text before it"

    def run(message: Mapping[str, Any], frame: Frame) -> str:
        text = first(message, frame)
        if type(text) is not str:
            raise unfit(why, text)
        charge(frame, len(text) >> 2)
        return change(text)

    return run


def _string(first: Run) -> Run:
    def run(message: Mapping[str, Any], frame: Frame) -> str:
        value = first(message, frame)
        if type(value) is str:
            return value
        if type(value) is float:
            charge(frame, SHOWN_REAL)
        return shown(value)

    return run


def _of_texts(name: str, first: Run, second: Run) -> Run:
    test, why = _TEXTS[name], f"`{name}` takes a text before it and in parentheses"

    def run(message: Mapping[str, Any], frame: Frame) -> bool:
        text, part = first(message, frame), second(message, frame)
        if type(text) is str and type(part) is str:
            return test(text, part, frame)
        raise unfit(why, text, part)

    return run


def _contains(text: str, part: str, frame: Frame) -> bool:
    charge(frame, len(text) * (4 + min(len(part), 128)) >> 7)
    return part in text


def _starts(text: str, part: str, frame: Frame) -> bool:
    charge(frame, len(part) >> 8)
    return text.startswith(part)


def _ends(text: str, part: str, frame: Frame) -> bool:
    charge(frame, len(part) >> 8)
    return text.endswith(part)


_TEXTS: dict[str, Callable[[str, str, Frame], bool]] = {
    "contains": _contains,
    "startsWith": _starts,
    "endsWith": _ends,
}
