"""A property of HPL as a pattern: its events with signals for their predicates, its aliases as variables."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from oracle_server.core.kinds import RESERVED
from oracle_server.specfiles.hpl.cel import cel
from oracle_server.specfiles.hpl.shared import both, conjuncts
from oracle_server.specfiles.hpl.tree import (
    Binary,
    Event,
    Events,
    Expr,
    NoCounterpartError,
    Property,
    Reference,
    referred,
)

Signals = dict[str, dict[str, str]]
"""For each topic the signals by their names, as expressions."""
_ORDER = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
_PLAIN = re.compile(
    r"(?!(and|or|not|implies|pre|once|historically|since|until|eventually|always|next|lasting|first|exists|forall|true"
    r"|false|inf)$)([a-z_]\w*|[A-Z]\w+)",
    re.ASCII,
)
_LONGEST_NAME = 100
_UNITS = (("s", 10**9), ("ms", 10**6), ("us", 10**3), ("ns", 1))


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


def pattern(draft: Draft) -> str:
    """The pattern of a property, whose signals are added. Raises `NoCounterpartError`, with its place."""
    prop = draft.prop
    for event in prop.events():
        draft.constraints[event.at] = _constraints(draft, event)
    opens, closes = _opening(draft), _events(draft, prop.closes)
    behaviour, trigger = _events(draft, prop.behaviour), _events(draft, prop.trigger)
    scope = "globally"
    if prop.opens:
        scope = f"after {opens} until {closes}" if prop.closes else f"after {opens}"
    elif prop.closes:
        scope = f"until {closes}"
    body = f"{trigger} {prop.verb} {behaviour}"
    if prop.verb == "requires":
        body = f"{behaviour} requires {trigger}"
    elif not prop.trigger:
        body = f"{prop.verb} {behaviour}"
    within = "" if prop.within is None else f" within {_time(prop.within)}"
    names = ", ".join(draft.variables.values())
    return f"{f'forall[{names}]. ' if names else ''}{scope}: {body}{within}"


def _constraints(draft: Draft, event: Event) -> list[str]:
    """What the predicate of an event asks for, as the constraints of an atom."""
    if event.topic.startswith("~"):
        raise NoCounterpartError(f"which node's is `{event.topic}`? write the whole name of the topic", event.at)
    own: list[Expr] = []
    found = []
    for part in conjuncts(event.predicate):
        if all(alias in ("", event.alias) for alias in referred(part)):
            own.append(part)
        else:
            found.append(_related(draft, event, part))
    if own and event.predicate is not None:
        name = _source(draft, event.predicate) if not found else " and ".join(_source(draft, part) for part in own)
        text = " && ".join(_operand(part, event, len(own)) for part in own)
        found.insert(0, _key(_signal(draft, event.topic, name, text)))
    return found


def _operand(part: Expr, event: Event, number: int) -> str:
    text = cel(part, event.alias)
    if isinstance(part, Reference) and number == 1:
        return f"{text} && true"  # a value that is no Boolean fails there, and would be as false in an atom
    loose = isinstance(part, Binary) and part.sign in ("or", "implies")
    return f"({text})" if loose and number > 1 else text


def _related(draft: Draft, event: Event, part: Expr) -> str:
    """A comparison with another message, whose value a variable has; by `<` and the like where an answer is awaited."""
    if not isinstance(part, Binary) or part.sign not in ("=", *_ORDER):
        raise NoCounterpartError(
            "of two messages, values can be compared by `=`, `<`, `<=`, `>` and `>=` alone", part.at
        )
    mine, other, sign = part.left, part.right, part.sign
    if not _of(mine, "", event.alias):
        mine, other, sign = other, mine, _ORDER.get(sign, sign)
    named = set(referred(other))
    if not _of(mine, "", event.alias) or len(named) != 1:
        raise NoCounterpartError("values of one message are compared with those of one other message", part.at)
    alias = named.pop()
    source = _bound(draft, event, alias, part)
    if sign != "=" and (event not in draft.prop.behaviour or draft.prop.verb not in ("causes", "some")):
        message = f"`{sign}` between two messages can be said of what `causes` and `some` wait for, and not here"
        raise NoCounterpartError(message, part.at)
    text = cel(other, alias)
    variable = draft.variables.get((alias, text))
    if variable is None:
        name = _source(draft, other).replace(f"@{alias}.", "")
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")[:40]
        variable = f"{alias}_{plain}"
        while variable in draft.variables.values():
            variable += "_"
        draft.variables[alias, text] = variable
        bound = f"{_key(_signal(draft, source.topic, name, text))}: *{variable}"
        draft.bound.setdefault(alias, []).append(bound)
    key = _key(_signal(draft, event.topic, _source(draft, mine), cel(mine, event.alias)))
    return f"{key}: *{variable}" if sign == "=" else f"{key} {sign} *{variable}"


def _of(expr: Expr, *names: str) -> bool:
    return all(alias in names for alias in referred(expr))


def _bound(draft: Draft, event: Event, alias: str, part: Expr) -> Event:
    """The event whose message an alias is, where that can be referred to."""
    prop = draft.prop
    if event in prop.opens:
        groups: tuple[Events, ...] = ()
    elif event in prop.closes:
        raise NoCounterpartError("what closes a scope can't be compared with the message that opened it", part.at)
    elif event in (prop.trigger if prop.verb == "requires" else prop.behaviour):
        groups = (prop.opens, prop.behaviour if prop.verb == "requires" else prop.trigger)
    else:
        groups = (prop.opens,)
    for group in groups:
        if any(each.alias == alias for each in group):
            if len(group) > 1:
                raise NoCounterpartError(f"`@{alias}` is one of several events, and may not be there", part.at)
            return group[0]
    raise NoCounterpartError(f"no message that comes before is called `{alias}`", part.at)


def _opening(draft: Draft) -> str:
    """What opens the scope: where values of its message are compared, the first alone, whatever they are."""
    opens, closes = draft.prop.opens, draft.prop.closes
    if not opens or opens[0].alias not in draft.bound:
        return _events(draft, opens)
    shared = next(both(opens, closes), None)
    if shared is not None:
        message = "a message may open and close the scope, and values of the one that opens are asked for"
        raise NoCounterpartError(message, shared[1].at)
    return f"({_atom(opens[0], _meets(draft, opens[0]))} and not pre {_open(draft)})"


def _open(draft: Draft) -> str:
    """That the scope, which something opens, is open."""
    opened = " or ".join(_atom(each, draft.constraints[each.at]) for each in draft.prop.opens)
    if not draft.prop.closes:
        return f"once ({opened})"
    closed = " or ".join(_atom(each, _meets(draft, each)) for each in draft.prop.closes)
    return f"(not ({closed}) since ({opened}))"


def _meets(draft: Draft, event: Event) -> list[str]:
    bound = draft.bound.get(event.alias, []) if event.alias else []
    return [*draft.constraints[event.at], *bound]


def _atom(event: Event, constraints: Iterable[str]) -> str:
    return "{" + ", ".join((f"topic: {event.topic}", *constraints)) + "}"


def _events(draft: Draft, events: Events) -> str:
    found = [_event(draft, event) for event in events]
    return found[0] if len(found) == 1 else f"({' or '.join(found)})"


def _event(draft: Draft, event: Event) -> str:
    """An event; where its message may open the scope too, that one is not meant, as the scope was not open before."""
    meets = _meets(draft, event)
    if event in (*draft.prop.trigger, *draft.prop.behaviour) and any(both(draft.prop.opens, (event,))):
        return f"({_atom(event, meets)} and pre {_open(draft)})"
    return f"{event.topic} {{{', '.join(meets)}}}" if meets else event.topic


def _signal(draft: Draft, topic: str, name: str, text: str) -> str:
    """The name of the signal of a topic that is an expression; it is called as HPL says it."""
    known = draft.signals.setdefault(topic, {})
    plain = "".join(c if c.isascii() and c.isprintable() and c != "\\" else "?" for c in name.replace('"', "'"))
    plain = f"msg.{plain}" if plain in RESERVED or plain == "todo" else plain
    plain = plain if len(plain) <= _LONGEST_NAME else f"{plain[:_LONGEST_NAME]}..."
    called, number = plain, 1
    while known.get(called, text) != text:
        number += 1
        called = f"{plain} ({number})"
    known[called] = draft.used.setdefault(topic, {})[called] = text
    return called


def _key(name: str) -> str:
    """A signal's name as the key of an atom: bare where it is a word, and none of a formula's own."""
    return name if _PLAIN.fullmatch(name) else json.dumps(name)


def _source(draft: Draft, expr: Expr) -> str:
    return " ".join(draft.source[expr.at : expr.end].split())


def _time(nanoseconds: int) -> str:
    unit, size = next((unit, size) for unit, size in _UNITS if not nanoseconds % size)
    return f"{nanoseconds // size}{unit}"
