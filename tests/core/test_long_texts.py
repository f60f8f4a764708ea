"""Long texts as values of variables and keys: told apart as all others are, and not kept as they are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import msgspec
import pytest

from oracle_server.core.session import Session
from oracle_server.core.spec import Property, StreamSpec
from oracle_server.core.verdicts import Judged
from oracle_server.engines.native import NativeEngine
from tests.core.sessions import A, Feed, open_session, outcomes, prop

LONG = "x" * 100_000


def opened(formula: str) -> Session:
    def native(property_: Property) -> NativeEngine:
        return NativeEngine(property_.formula, property_.time)

    return open_session([prop("p", formula)], attach={"m": [A]}, streams=[StreamSpec("/a")], maker=native, by="arrival")


def judged(session: Session, messages: Iterable[Mapping[str, object]]) -> list[Judged]:
    feed = Feed(session)
    return [item for n, message in enumerate(messages, 1) for item in feed(A, n, message)]


@pytest.mark.parametrize("formula", ["exists[x]. {b: *x} and once{a: *x}", "not forall[x]. {b: *x} -> not once{a: *x}"])
def test_they_are_told_apart_by_all_their_characters(formula: str) -> None:
    said = [{"a": LONG + "1"}, {"b": LONG + "2"}, {"b": LONG + "1"}, {"b": LONG}, {"b": LONG[1:] + "11"}]
    found = outcomes(judged(opened(formula), said))
    assert [outcome.endswith("true") for outcome in found] == [False, False, True, False, False]


def test_what_is_kept_of_them_is_short() -> None:
    session = opened("exists[x]. {b: *x} and once{a: *x}")
    judged(session, [{"a": f"{LONG}{n}"} for n in range(100)])
    state = session.judges["arrival"].properties[0].snapshot()
    assert len(msgspec.json.encode(state)) < len(LONG)


def test_explanations_know_them_again() -> None:
    session = opened("forall[x]. {b: *x} -> {a: *x, c: 2}")
    (broken,) = judged(session, [{"a": LONG, "b": LONG, "c": 1}])
    (verdict,) = broken.verdicts
    assert verdict.explanation is not None
    assert failing(verdict.explanation.why) == {"c"}


def failing(why: Any) -> set[str]:
    """The signals that any part of an explanation says not to be as they should."""
    if isinstance(why, list):
        return {name for part in why for name in failing(part)}
    if not isinstance(why, dict):
        return set()
    return {each["signal"] for each in why.get("failing", ())} | failing([*why.values()])
