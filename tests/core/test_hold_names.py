"""Names of signals that one stream holds and another one has too."""

from __future__ import annotations

import itertools

import pytest

from oracle_server.core.events import StreamKey
from oracle_server.core.hazards.inspection import inspect
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec
from tests.core.sessions import Feed, prop


def test_a_signal_that_another_stream_holds_is_warned_of() -> None:
    """Not refused: sessions with such specs are in histories, and would not be restored."""
    holds = StreamSpec("/mode", hold=frozenset({"mode"}), signals={"mode": "msg.mode"})
    others = (StreamSpec("/a", signals={"mode": "msg.mode", "v": "msg.v"}), StreamSpec("/b"))
    (found,) = inspect(Spec("s", (holds, *others), (prop("p", "{mode: 1}"),)))
    assert (found.severity, found.path) == ("warning", ("streams", 1, "signals", "mode"))
    assert "held by /mode" in found.message


STREAMS = """
id: s
ordering: {by: arrival}
streams:
  - {topic: /login, signals: {user: msg.user}, hold: [user]}
  - {topic: /order, signals: {user: msg.user, amount: msg.amount}}
  - {topic: /ship, signals: {to: msg.to}}
"""
Message = tuple[str, dict[str, object]]
FAILS: dict[str, object] = {"user": {"id": 3}, "amount": 9}
"""A message of which `user` is no scalar."""


def session_of(rest: str) -> Session:
    ready = plan(parse_spec(STREAMS + rest, "s").spec)
    session = Session(ready, make_engines(ready))
    session.attach("m", [StreamKey(each, "topic") for each in ("/login", "/order", "/ship")], 0)
    return session


def fed(session: Session, *events: Message, first: int = 1) -> list[list[str]]:
    """The outcomes of the properties at each of these events."""
    feed = Feed(session, {"m": itertools.count(first)})
    judged = [j for n, (name, data) in enumerate(events, first) for j in feed(StreamKey(name, "topic"), n, data)]
    return [[v.outcome.value for v in j.verdicts] for j in judged]


LOGIN: Message = ("/login", {"user": "ann"})
SHIP: Message = ("/ship", {"to": "x"})


def test_a_signal_that_failed_is_not_what_another_stream_holds() -> None:
    rest = (
        "properties:\n"
        "  - {id: now, formula: '{topic: /order} -> {user: bob}'}\n"
        "  - {id: before, formula: '{topic: /ship} -> once {topic: /order, user: ann}'}\n"
        "  - {id: settled, latch: true, formula: 'not {topic: /order, user: ann}'}\n"
    )
    lost: Message = ("/login", {"user": {}})
    for event in (LOGIN, lost):  # a held one that failed hides nothing either
        found = fed(session_of(rest), event, ("/order", FAILS), SHIP)
        assert found[1] == ["unknown"] * 3
        if event is LOGIN:
            assert found[2] == ["currently_true", "currently_false", "currently_true"]


def test_an_own_value_counts_before_one_that_another_stream_holds() -> None:
    rest = "properties:\n  - {id: p, formula: '{topic: /order} -> {user: bob}'}\n"
    assert fed(session_of(rest), LOGIN, ("/order", {"user": "bob"}))[-1] == ["currently_true"]
    assert fed(session_of(rest), LOGIN, ("/order", {"amount": 1}))[-1] == ["currently_false"], "it is held"


@pytest.mark.parametrize(
    "derive",
    [
        "define: {ordered: '{topic: /order}', shipped: '{topic: /ship}'}\n"
        "derive: {it: {sequence: 'ordered ordered* shipped', by: user, forget: 1h}}\n"
        "properties: [{id: p, formula: 'not {topic: /ship, it: matched}'}]",
        "define: {ordered: '{topic: /order}', shipped: '{topic: /ship}'}\n"
        "derive: {it: {sequence: 'ordered ordered* shipped', by: [user, amount], forget: 1h}}\n"
        "properties: [{id: p, formula: 'not {topic: /ship, it: matched}'}]",
        "derive: {it: {sum: amount, over: 1h, by: user}}\n"
        "properties: [{id: p, formula: '{topic: /ship} -> {it <= 5}'}]",
        "derive: {it: {last: amount, by: user, forget: 1h}}\n"
        "properties: [{id: p, formula: '{topic: /ship} -> {it <= 5}'}]",
    ],
    ids=["machine", "parametric", "window", "last"],
)
def test_where_the_key_failed_it_may_have_been_any_and_not_the_held_one(derive: str) -> None:
    """Of a machine by several signals none is remembered, which an event of some values can't tell."""
    session, again = session_of(derive), session_of(derive)
    fed(session, LOGIN, ("/order", FAILS))
    saved = session.snapshot()
    assert saved is not None
    again.restore(saved, 3)
    assert fed(session, SHIP, first=3) == fed(again, SHIP, first=3) == [["unknown"]]
