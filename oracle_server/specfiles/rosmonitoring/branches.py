"""The two ways that a branch takes through a function, made one state."""

from __future__ import annotations

from oracle_server.specfiles.rosmonitoring.cel import collapsed
from oracle_server.specfiles.rosmonitoring.state import State
from oracle_server.specfiles.rosmonitoring.values import (
    Kept,
    Raises,
    UnfollowableError,
    Unread,
    UntranslatableError,
    Value,
    choice,
    same,
)


def merged(test: Value, yes: State, no: State) -> State:
    """The state after two branches, of which the first is taken where the test holds.

    Raises `UnfollowableError` where nothing can be said of where the function failed in them.
    """
    found = State(around=yes.around, fails=_failing(test, yes.fails, no.fails), lost=yes.lost | no.lost)
    for name in dict.fromkeys((*yes.variables, *no.variables)):
        a, b = yes.variables.get(name, Raises("UnboundLocalError")), no.variables.get(name, Raises("UnboundLocalError"))
        found.variables[name] = _chosen(test, a, b)
    for name in dict.fromkeys((*yes.predicates, *no.predicates)):
        found.predicates[name] = _chosen(
            test, yes.predicates.get(name, Kept(name)), no.predicates.get(name, Kept(name))
        )
    return found


def _failing(test: Value, yes: Value, no: Value) -> Value:
    try:
        return choice(test, yes, no)
    except UntranslatableError:
        raise UnfollowableError from None


def _chosen(test: Value, yes: Value, no: Value) -> Value:
    if same(yes, no):
        return yes
    try:
        return collapsed(choice(test, yes, no))
    except UntranslatableError:
        return Unread("")
