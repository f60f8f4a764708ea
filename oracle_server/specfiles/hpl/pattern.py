"""A property of HPL as a pattern: its scope, its events with signals for their predicates, its verb and its time."""

from __future__ import annotations

from collections.abc import Iterable

from oracle_server.specfiles.hpl.cel import cel
from oracle_server.specfiles.hpl.draft import Draft, key, signal, text_of
from oracle_server.specfiles.hpl.related import related
from oracle_server.specfiles.hpl.shared import both, conjuncts
from oracle_server.specfiles.hpl.tree import (
    Binary,
    Call,
    Constant,
    Event,
    Events,
    Expr,
    Group,
    NoCounterpartError,
    Number,
    Property,
    Range,
    Reference,
    Text,
    Unary,
    referred,
)

_VALUES = (Call, Constant, Group, Number, Range, Text)
_ARITHMETIC = ("+", "-", "*", "/", "**")
_UNITS = (("s", 10**9), ("ms", 10**6), ("us", 10**3), ("ns", 1))


def pattern(draft: Draft) -> str:
    """The pattern of a property, whose signals are added. Raises `NoCounterpartError`, with its place."""
    prop = draft.prop
    _check_aliases(prop)
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


def _check_aliases(prop: Property) -> None:
    known: set[str] = set()
    for event in prop.events():
        if event.alias in known:
            raise NoCounterpartError(f"two messages are called `{event.alias}`", event.at)
        known |= {event.alias} - {""}


def _constraints(draft: Draft, event: Event) -> list[str]:
    """What the predicate of an event asks for, as the constraints of an atom."""
    if event.topic.startswith("~"):
        raise NoCounterpartError(f"which node's is `{event.topic}`? write the whole name of the topic", event.at)
    own: list[Expr] = []
    found = []
    for part in conjuncts(event.predicate):
        if isinstance(part, _VALUES) or (isinstance(part, Unary | Binary) and part.sign in _ARITHMETIC):
            raise NoCounterpartError("this is a value, and no condition that holds or not", part.at)
        if all(alias in ("", event.alias) for alias in referred(part)):
            own.append(part)
        else:
            found.append(related(draft, event, part))
    if own and event.predicate is not None:
        name = text_of(draft, event.predicate) if not found else " and ".join(text_of(draft, part) for part in own)
        text = " && ".join(_operand(part, event, len(own)) for part in own)
        found.insert(0, key(signal(draft, event.topic, name, text)))
    return found


def _operand(part: Expr, event: Event, number: int) -> str:
    text = cel(part, event.alias)
    if isinstance(part, Reference) and number == 1:
        return f"{text} && true"  # a value that is no Boolean fails there, and would be as false in an atom
    loose = isinstance(part, Binary) and part.sign in ("or", "implies")
    return f"({text})" if loose and number > 1 else text


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


def _time(nanoseconds: int) -> str:
    unit, size = next((unit, size) for unit, size in _UNITS if not nanoseconds % size)
    return f"{nanoseconds // size}{unit}"
