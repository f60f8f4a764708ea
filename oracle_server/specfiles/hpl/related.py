"""Comparisons of a message with one that came before, by its alias: the variables that have its values."""

from __future__ import annotations

import re

from oracle_server.specfiles.hpl.cel import cel
from oracle_server.specfiles.hpl.draft import Draft, key, signal, text_of
from oracle_server.specfiles.hpl.tree import Binary, Event, Events, Expr, NoCounterpartError, referred

_ORDER = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}


def related(draft: Draft, event: Event, part: Expr) -> str:
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
    named_by = _bound(draft, event, alias, part)
    if sign != "=" and (event not in draft.prop.behaviour or draft.prop.verb not in ("causes", "some")):
        message = f"`{sign}` between two messages can be said of what `causes` and `some` wait for, and not here"
        raise NoCounterpartError(message, part.at)
    variable = _variable(draft, named_by, alias, other)
    compared = key(signal(draft, event.topic, text_of(draft, mine), cel(mine, event.alias)))
    return f"{compared}: *{variable}" if sign == "=" else f"{compared} {sign} *{variable}"


def _variable(draft: Draft, event: Event, alias: str, value: Expr) -> str:
    """The variable that has a value of a message, which its event binds."""
    text = cel(value, alias)
    variable = draft.variables.get((alias, text))
    if variable is None:
        name = text_of(draft, value).replace(f"@{alias}.", "")
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")[:40]
        variable = f"{alias}_{plain}"
        while variable in draft.variables.values():
            variable += "_"
        draft.variables[alias, text] = variable
        bound = f"{key(signal(draft, event.topic, name, text))}: *{variable}"
        draft.bound.setdefault(alias, []).append(bound)
    return variable


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
