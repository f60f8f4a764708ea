"""Reads `pattern:`, as in `after /start until /stop: {goal: *} causes /status {done} within 60s`."""

from __future__ import annotations

from collections.abc import Mapping

from oracle_server.core.derived.words import for_each
from oracle_server.core.errors import FormulaError
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import looks_ahead
from oracle_server.core.formula.names import Names
from oracle_server.core.formula.parse import MAX_TEXT, check
from oracle_server.core.formula.size import Size
from oracle_server.core.formula.size import measured as sized
from oracle_server.core.formula.tree import ALL_PAST, Bound, Formula, Or, Position, Time, Use
from oracle_server.core.sentences import measures, patterns, scopes
from oracle_server.core.sentences.reader import Meant, Reader
from oracle_server.core.sentences.tokens import Token, place, tokens

SCOPES = ("globally", "after", "until", "while")
VERBS = ("causes", "requires", "forbids")
LEADS = ("no", "some", "always")
_BODY = "a pattern says `no E`, `some E`, `always …`, or `E causes E`, `E requires E`, `E forbids E`"
_EVENT = (
    "an event is a stream, as `/cmd_vel` or `/cmd_vel {speed > 1}`, an atom, a name of `define:`, or what stands in "
    "parentheses, as `(… or …)` and `(not {armed})`"
)


def read_pattern(text: str, names: Names, streams: Mapping[str, str], time: Time | None, name: str = "p") -> Meant:
    """What the pattern of a property, whose `name` it is, stands for; `time` is what that says that its bounds count.

    `streams` maps the names of streams to their groups. Raises `FormulaError` with line and column.
    """
    if len(text) > MAX_TEXT:
        raise FormulaError(f"the pattern has {len(text)} characters; at most {MAX_TEXT} are read")
    if not text.strip():
        raise FormulaError(f"the pattern is empty: {_BODY}")
    reader = Reader(text, tokens(text), names, streams, name=name)
    bound = _bound(reader, time)
    formula = _quantified(reader, bound)
    if reader.measures:
        timed(reader, "seconds", time, reader.pieces[0])
    return Meant(checked(formula), reader.time, tuple(reader.measures), tuple(reader.states))


def checked(formula: Formula) -> Formula:
    """A formula that was put together, each part an object of its own. Raises `FormulaError` where it is none."""
    sized(formula, _unwritten)
    whole = scopes.copied(formula)
    check(whole)
    return whole


def at_steps(reader: Reader, formula: Formula) -> Formula:
    """What a sentence says of steps: a deadline breaks only what is awaited."""
    return scopes.at_steps(formula) if reader.time == "seconds" and not looks_ahead(formula) else formula


def _unwritten(use: Use) -> Size:
    raise FormulaError(f"`{use.call}` is not written out", *use.at)


def timed(reader: Reader, found: Time, time: Time | None, piece: Token) -> None:
    """Let a sentence have the time of its duration, where that is not another than its property's."""
    if time not in (None, found):
        reader.refuse(f"this counts {found}, and the property has `time: {time}`; leave `time` out", piece)
    reader.time = found


def _bound(reader: Reader, time: Time | None) -> Bound:
    """The bound behind `within`, at the end, which is taken off."""
    reader.time = time or "steps"
    found = [i for i, piece in enumerate(reader.pieces) if piece.text == "within"]
    if not found:
        return ALL_PAST
    reader.at = found[-1] + 1
    piece = reader.next
    distance, counted = reader.duration()
    reader.end("`within` and its time end a pattern")
    timed(reader, counted, time, piece)
    word = reader.pieces[found[-1]]
    reader.pieces = [*reader.pieces[: found[-1]], Token("", "", word.start, word.start)]
    reader.at = 0
    return Bound(0, distance)


def _quantified(reader: Reader, bound: Bound) -> Formula:
    bound_by: list[tuple[str, Position]] = []
    while (word := reader.word("forall")) is not None:
        group = reader.take()
        variables = [v.strip() for v in group.text[1:-1].split(",")]
        if group.kind != "[" or not all(v.isidentifier() and v.isascii() for v in variables):
            reader.refuse("variables stand in square brackets, as in `forall[g]. …`", group)
        if not reader.word("."):
            reader.refuse("a `.` stands behind the variables, as in `forall[g]. …`")
        bound_by += [(name, place(reader.text, word.start)) for name in variables]
    formula = _scoped(reader, bound)
    used = {name for atom in tree.atoms(formula) for _, name in atom.refs}
    for measure in reader.measures if any(name not in used for name, _ in bound_by) else ():
        for message, variable_at in for_each(measure):
            raise FormulaError(message, *variable_at)
    for name, at in reversed(bound_by):
        formula = tree.Forall(name, formula, at)
    return formula


def _scoped(reader: Reader, bound: Bound) -> Formula:
    rest = reader.pieces[reader.at :]
    colon = next((reader.at + i for i, piece in enumerate(rest) if piece.text == ":"), None)
    if colon is None:
        if reader.next.text in SCOPES and reader.next.text not in reader.names.known:
            reader.refuse("a scope ends with `:`, as in `after /start: no /error`")
        return _body(reader, scopes.EVERYWHERE, bound)
    scope = _scope(reader, colon)
    if reader.at != colon:
        reader.refuse(f"{reader.shown()} is not expected here: a scope ends with `:`", None, SCOPES)
    reader.take()
    return _body(reader, scope, bound)


def _scope(reader: Reader, colon: int) -> scopes.Scope:
    if reader.word("globally"):
        return scopes.EVERYWHERE
    if reader.word("after"):
        first = _event(reader)
        return scopes.between(first, _event(reader)) if reader.word("until") else scopes.after(first)
    if reader.word("until"):
        return scopes.until(_event(reader))
    if not reader.word("while"):
        message = "a scope is `globally`, `after E`, `until E`, `after E until E` or `while φ`, and ends with `:`"
        reader.refuse(f"{message}; {reader.shown()} is none", None, SCOPES)
    start, reader.at = reader.next.start, colon
    state = reader.formula(start, reader.pieces[colon].start)
    reader.states.append(state)
    return scopes.during(state)


def _body(reader: Reader, scope: scopes.Scope, bound: Bound) -> Formula:
    word, at = reader.next, place(reader.text, reader.next.start)
    if reader.word("always"):
        if bound is not ALL_PAST:
            reader.refuse("`always` has no `within`; what must hold for a while is asked by `forbids`", word)
        start, reader.at = reader.next.start, len(reader.pieces) - 1
        return patterns.universality(scope, reader.formula(start, reader.next.start))
    if reader.word("no"):
        found = patterns.absence(scope, _event(reader), bound)
    elif reader.word("some"):
        found = patterns.existence(scope, _event(reader), bound, at)
    elif reader.phrase("at", "most"):
        return patterns.universality(scope, _at_most(reader, bound))
    elif word.kind == "word" and word.text not in reader.names.known:
        reader.refuse(f"{reader.shown()} is not understood: {_BODY}", None, (*LEADS, *SCOPES, *reader.names.known))
    else:
        found = _pair(reader, scope, bound)
    reader.end("behind it stands `within` and a time, or nothing")
    return found if reader.measures else at_steps(reader, found)


def _at_most(reader: Reader, bound: Bound) -> Formula:
    piece = reader.take()
    if not piece.text.isdigit() or len(piece.text) > 9:
        reader.refuse(f"here stands how many, as in `at most 3 /error within 1s`, and not {reader.shown(piece)}", piece)
    event = _event(reader)
    if reader.time != "seconds" or not bound.upper:
        reader.refuse("how often is a matter of time: write `within` and a duration, as `within 1s`")
    reader.end("behind it stands `within` and a time")
    return measures.at_most(reader, int(piece.text), event, bound.upper)


def _pair(reader: Reader, scope: scopes.Scope, bound: Bound) -> Formula:
    left = _event(reader)
    if bound is ALL_PAST and (measured := measures.measure(reader, left)) is not None:
        return patterns.universality(scope, measured)
    verb = reader.next
    at: Position = place(reader.text, verb.start)
    if not reader.word(*VERBS):
        reader.refuse(
            f"behind an event stands `causes`, `requires`, `forbids`, `every 1s`, or `at least 10 Hz over 2s`, and not "
            f"{reader.shown()}",
            None,
            (*VERBS, "every"),
        )
    right = _event(reader)
    if left == right:
        reader.refuse(
            f"both events are the same, and one that is both answers itself: what `{verb.text}` says would hold "
            "always, or never; write a formula, as in `{topic: /a} -> not pre once[:5] {topic: /a}`",
            verb,
        )
    if verb.text.lower() == "causes":
        return patterns.response(scope, left, right, bound, at)
    if verb.text.lower() == "requires":
        return patterns.precedence(scope, left, right, bound)
    return patterns.prevention(scope, left, right, bound)


def _event(reader: Reader) -> Formula:
    piece = reader.next
    if piece.kind == "stream":
        return reader.stream()
    if piece.kind == "{" or (piece.kind == "word" and piece.text in reader.names.known):
        return reader.atom()
    if piece.kind != "(":
        reader.refuse(f"{_EVENT}; {reader.shown()} is none", piece, (*reader.names.known, *reader.streams))
    reader.take()
    inner = reader.inside(piece)
    if any(part.kind == "stream" for part in inner.pieces):
        return _any_of(inner)
    return reader.formula(piece.start, piece.end)


def _any_of(reader: Reader) -> Formula:
    """Any of several events, between parentheses."""
    found = _event(reader)
    while reader.word("or"):
        found = Or(found, _event(reader))
    reader.end("between two events in parentheses stands `or`")
    return found
