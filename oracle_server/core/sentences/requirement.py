"""Reads `requirement:`, FRETish, as in `In auto, when low the robot shall within 30 seconds satisfy docking`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.names import Names
from oracle_server.core.formula.parse import MAX_TEXT
from oracle_server.core.formula.tree import And, Bound, Formula, Implies, Not, Or, Pre, Time
from oracle_server.core.sentences import scopes, timings
from oracle_server.core.sentences.pattern import at_steps, checked, timed
from oracle_server.core.sentences.reader import Meant, Reader
from oracle_server.core.sentences.scopes import Scope
from oracle_server.core.sentences.tokens import place, tokens

SCOPES = ("in", "while", "during", "except", "unless", "before", "after")
CONDITIONS = ("when", "whenever", "upon", "if", "where")
TIMINGS = (
    *("immediately", "next", "always", "never", "within", "for", "after", "until", "before"),
    *("eventually", "finally", "satisfy"),
)
_SENTENCE = "a requirement is, as in FRETish, `[in MODE,] [when CONDITION] the ROBOT shall [TIMING] satisfy RESPONSE`"
_TIMINGS = (
    "behind `shall` stands `satisfy`, or before it one of `immediately`, `at the next timepoint`, `always`, `never`, "
    "`within 5 steps`, `for 5 steps`, `after 5 steps`, `until …`, `before …`, `eventually`, `finally`"
)


class _Asked(NamedTuple):
    """What a sentence says before its timing."""

    scope: Scope
    trigger: Formula


def read_requirement(text: str, names: Names, streams: Mapping[str, str], time: Time | None) -> Meant:
    """What a requirement stands for; `time` is what the property says that its bounds count, if it says so.

    `streams` maps the names of streams to their groups. Raises `FormulaError` with line and column.
    """
    if len(text) > MAX_TEXT:
        raise FormulaError(f"the requirement has {len(text)} characters; at most {MAX_TEXT} are read")
    if not text.strip():
        raise FormulaError(f"the requirement is empty: {_SENTENCE}")
    reader = Reader(text, tokens(text), names, streams, time or "steps")
    _clock(reader, time)
    scope = _scope(reader)
    reader.word(",")
    asked = _Asked(scope, _trigger(reader, scope))
    _component(reader)
    formula = _timing(reader, asked)
    reader.word(".")
    reader.end("a requirement ends with its response; what says when stands before `satisfy`")
    return Meant(checked(formula), reader.time, states=tuple(reader.states))


def _clock(reader: Reader, time: Time | None) -> None:
    """Find out what a duration behind `shall` counts, before any formula is read."""
    for i, piece in enumerate(reader.pieces):
        if piece.kind == "number" and i and reader.pieces[i - 1].text.lower() in ("within", "for", "after"):
            reader.at = i
            _, counted = reader.duration()
            timed(reader, counted, time, piece)
    reader.at = 0


def _scope(reader: Reader) -> Scope:
    if reader.next.text.lower() == "only":
        reader.refuse(
            "`only` is not taken: it asks that the opposite holds elsewhere; write that as a requirement of its own, "
            "with `except in`, `before` or `after`"
        )
    if reader.phrase("when", "in") or reader.phrase("while", "in"):
        return scopes.during(_mode(reader))
    if reader.word("in", "during", "while"):
        return scopes.during(_mode(reader))
    word = reader.word("except", "unless")
    if word is not None:
        if not reader.word("in", "during", "while", "when"):
            reader.refuse(f"behind `{word.text}` stands a mode, as in `{word.text} in charging`", None, ("in", "while"))
        return scopes.during(Not(_mode(reader)))
    if reader.word("before"):
        event = _mode(reader)
        reader.states.clear()  # only that it comes counts
        return scopes.until(event)
    if reader.word("after"):
        mode = _mode(reader)
        return scopes.after(And(Not(mode), Pre(mode)))
    return scopes.EVERYWHERE


def _mode(reader: Reader) -> Formula:
    found = _either(reader)
    reader.states.append(found)
    if "mode" not in reader.names.known:
        reader.word("mode")
    return found


def _trigger(reader: Reader, scope: Scope) -> Formula:
    word = reader.word(*CONDITIONS)
    condition = _either(reader) if word else None
    if word is not None and condition is not None and word.text.lower() != "whenever":  # which asks at each step
        reader.states.append(condition)
    reader.word(",")
    reader.word("then")
    return timings.trigger(scope, condition, each=word is not None and word.text.lower() == "whenever")


def _component(reader: Reader) -> None:
    reader.word("the")
    piece = reader.next
    if piece.kind != "word" or piece.text.lower() == "shall":
        reader.refuse(f"here stands who is asked, as in `the robot shall`, and not {reader.shown()}; {_SENTENCE}")
    reader.take()
    if not reader.word("shall"):
        known = ("shall", *(() if reader.at > 1 else (*SCOPES, *CONDITIONS)))
        reader.refuse(f"behind `{piece.text}` stands `shall`, and not {reader.shown()}; {_SENTENCE}", None, known)


def _timing(reader: Reader, asked: _Asked) -> Formula:
    reader.word(",")
    for phrase, read in _PHRASES.items():
        if reader.phrase(*phrase.split()):
            found = read(reader, asked)
            return found if phrase in _LASTING else at_steps(reader, found)
    piece = reader.next
    word, at = piece.text.lower(), place(reader.text, piece.start)
    if word == "satisfy":
        return _at_last(reader, asked)
    if not reader.word("within", "for", "after"):
        reader.refuse(f"{_TIMINGS}; {reader.shown()} is not taken", None, TIMINGS)
    if word == "after" and reader.time == "seconds":
        reader.refuse(
            "`after` is taken with steps alone, since no step need lie at the very time; write two requirements, "
            "`for 5 seconds satisfy !docked` and `within 6 seconds satisfy docked`",
            piece,
        )
    (scope, trig), distance = asked, reader.duration()[0]
    response = _response(reader)
    if word == "within":
        return timings.within(scope, trig, response, Bound(0, distance), at)
    if word == "for":
        return at_steps(reader, timings.throughout(scope, trig, response, Bound(0, distance)))
    return timings.after(scope, trig, response, distance, at)


def _immediately(reader: Reader, asked: _Asked) -> Formula:
    return timings.immediately(asked.trigger, _response(reader))


def _at_next(reader: Reader, asked: _Asked) -> Formula:
    return timings.at_next(asked.scope, asked.trigger, _response(reader))


def _always(reader: Reader, asked: _Asked) -> Formula:
    return timings.throughout(asked.scope, asked.trigger, _response(reader), Bound())


def _never(reader: Reader, asked: _Asked) -> Formula:
    return timings.throughout(asked.scope, asked.trigger, Not(_response(reader)), Bound())


def _until(reader: Reader, asked: _Asked) -> Formula:
    stop = _either(reader)
    return timings.until(asked.scope, asked.trigger, _response(reader), stop)


def _before(reader: Reader, asked: _Asked) -> Formula:
    stop = _either(reader)
    return timings.before(asked.scope, asked.trigger, _response(reader), stop)


def _at_last(reader: Reader, asked: _Asked) -> Formula:
    at = place(reader.text, reader.next.start)
    return timings.at_last(asked.scope, asked.trigger, _response(reader), at)


def _finally(reader: Reader, asked: _Asked) -> Formula:
    if asked.scope.stays:
        reader.refuse(
            "`finally` is about the last step of a scope, and this one never ends; write it with `in`, `before` or "
            "`except in`",
            reader.pieces[reader.at - 1],
        )
    return timings.finally_(asked.scope, asked.trigger, _response(reader))


_PHRASES: Mapping[str, Callable[[Reader, _Asked], Formula]] = {
    "immediately": _immediately,
    **dict.fromkeys(("at the next timepoint", "next timepoint", "next"), _at_next),
    "always": _always,
    "never": _never,
    "until": _until,
    "before": _before,
    "eventually": _at_last,
    "finally": _finally,
}
"""The timings without a duration."""
_LASTING = ("always", "never")
"""Those that are judged at deadlines too: what they ask for may end, or begin, as time passes."""


def _response(reader: Reader) -> Formula:
    reader.word(",")
    if not reader.word("satisfy"):
        reader.refuse(f"the response begins with `satisfy`, and not {reader.shown()}", None, TIMINGS)
    return _either(reader)


def _either(reader: Reader) -> Formula:
    """Names and atoms joined as in FRETish, in its words or ours: `!`, `&`, `|` or `xor`, `=>` or `<=>`, `if`."""
    conditions = []
    while "if" not in reader.names.known and reader.word("if"):
        conditions.append(_implied(reader))
        if not reader.word("then"):
            reader.refuse(f"behind `if` and what it asks stands `then`, and not {reader.shown()}", None, ("then",))
    found = _implied(reader)
    while conditions:
        found = Implies(conditions.pop(), found)
    return found


def _implied(reader: Reader) -> Formula:
    parts = [_disjunction(reader)]
    while reader.word("=>", "->", "implies"):
        parts.append(_disjunction(reader))
    mark = reader.word("<=>", "<->")
    if mark is not None:
        parts.append(_disjunction(reader))
        if len(parts) > 2 or reader.next.text in ("=>", "->", "implies", "<=>", "<->"):
            reader.refuse(f"how `{mark.text}` is grouped with others is not said: put one of them in parentheses", mark)
        one, other = parts
        return And(Implies(one, other), Implies(other, one))
    found = parts.pop()
    while parts:
        found = Implies(parts.pop(), found)
    return found


def _disjunction(reader: Reader) -> Formula:
    found = _conjunction(reader)
    while mark := reader.word("|", "||", "or", "xor"):
        other = _conjunction(reader)
        apart = mark.text.lower() == "xor"
        found = Or(And(found, Not(other)), And(Not(found), other)) if apart else Or(found, other)
    return found


def _conjunction(reader: Reader) -> Formula:
    found = _single(reader)
    while reader.word("&", "&&", "and"):
        found = And(found, _single(reader))
    return found


def _single(reader: Reader) -> Formula:
    negated = 0
    while reader.word("!", "not"):
        negated += 1
    found = _operand(reader)
    for _ in range(negated):
        found = Not(found)
    return found


def _operand(reader: Reader) -> Formula:
    piece = reader.next
    if piece.kind == "(":
        reader.take()
        inner = reader.inside(piece)
        found = _either(inner)
        inner.end("names are joined by `&`, `|`, `!` and `=>`")
        return found
    if piece.kind == "stream":
        return reader.stream()
    if piece.kind not in ("{", "word"):
        reader.refuse(f"here stands a name of `define:`, or an atom as `{{speed > 0.1}}`, and not {reader.shown()}")
    following = reader.pieces[reader.at + 1]
    if piece.kind == "word" and piece.text not in reader.names.known:
        _strange(reader, following.text)
    return reader.atom()


def _strange(reader: Reader, follows: str) -> None:
    """Refuse what FRETish has, and is not taken."""
    word = reader.next.text
    if word.lower() in ("persisted", "persists", "occurred", "occurs", "previous", "prebool", "preint"):
        reader.refuse(
            f"`{word}` is not taken; give it a name under `define:`, as `docked_for: 'lasting[5] {{docked}}'` or "
            "`'once[:5] {docked}'`"
        )
    if word.lower() == "if":
        reader.refuse("`if … then …` stands in parentheses here, as `low => (if auto then docking)`")
    if word.lower() == "probability":
        reader.refuse("`probability` is not taken: a property holds at a step, or does not")
    if follows in ("<", ">", "=", "+", "-", "*", "%"):
        reader.refuse(f"`{word}` is compared in braces, as `{{{word} > 1}}`")
