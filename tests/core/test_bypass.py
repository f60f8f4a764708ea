"""Streams that are bypassed: which properties it concerns, and for how long."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.core.bypass import Bypass, Bypasses
from oracle_server.core.events import StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import External, Ordering, Property, Spec, StreamSpec
from oracle_server.core.verdicts import Judged
from tests.core.sessions import MODE, A, B, Feed, degraded, open_session, outcomes, prop
from tests.core.test_ticks import native

ROGUE = Bypass("/rogue publishes it past the monitor", 7)


def readers(*properties: Property) -> dict[str, set[int]]:
    streams = (
        StreamSpec("/cmd", signals={"speed": "msg.v"}, action="filter"),
        StreamSpec("/mode", signals={"mode": "msg.m"}, hold=frozenset({"mode"})),
        StreamSpec("/plain"),
        StreamSpec("/s", "request"),
        StreamSpec("/s", "response"),
    )
    return {name: set(found) for name, found in plan(Spec("s", streams, properties, Ordering())).readers.items()}


@pytest.mark.parametrize(
    ("formula", "read"),
    [
        ("not {speed > 1}", {"/cmd", "/plain", "/s"}),  # a stream without `signals` may have any
        ('not {topic: "/cmd", speed > 1}', {"/cmd"}),
        ('{topic: "/cmd", mode: 1}', {"/cmd", "/mode"}),  # what is held is there beside all others
        ("not {mode: 1}", {"/mode"}),
        ('{topic: "/plain", x: 1} -> once {mode: 2}', {"/plain", "/mode"}),
        ('once {service: "/s", kind: request}', {"/s"}),
        ("once {kind: topic}", {"/cmd", "/mode", "/plain"}),
        ('pre {monitor: "m"}', {"/cmd", "/mode", "/plain", "/s"}),
    ],
)
def test_a_property_reads_the_streams_whose_own_signals_or_names_it_asks_for(formula: str, read: set[str]) -> None:
    assert {name for name, found in readers(prop("p", formula)).items() if found} == read


def test_what_guards_a_stream_is_concerned_though_it_reads_nothing_of_it() -> None:
    assert readers(prop("p", "{mode: 1}", guards=frozenset({"/cmd"})))["/cmd"] == {0}


def test_an_oracle_elsewhere_reads_what_it_is_told() -> None:
    told: Any = External("ws://there", streams=frozenset({"/plain"}))
    found = readers(Property("p", prop("p", "{x}").formula, external=told))
    assert {name for name, concerned in found.items() if concerned} == {"/plain"}


def session_of() -> tuple[Session, Feed]:
    first, second = prop("p", 'not {topic: "/a", v: 1}'), prop("q", 'not {topic: "/b", v: 1}')
    session = open_session([first, second], attach={"m": [A, B, MODE]}, maker=native, by="arrival")
    return session, Feed(session)


def test_it_lasts_until_it_ends_unlike_a_loss() -> None:
    session, feed = session_of()
    judged: list[Judged] = feed(A, 10)
    session.bypass("m", {A: ROGUE})
    judged += feed(B, 11) + feed(A, 12)
    assert session.bypasses.of(0) == [ROGUE]
    assert session.bypasses.of(1) == []
    session.bypass("m", {})
    judged += feed(A, 13)
    assert degraded(judged, "p") == [False, True, True, False]
    assert not any(degraded(judged, "q"))
    assert set(outcomes(judged)) == {"currently_true"}, "what is told is not changed by it"


def test_a_loss_meanwhile_stays() -> None:
    session, feed = session_of()
    session.bypass("m", {A: ROGUE})
    judged = feed(A, 10) + feed(A, 11, lost=1)
    session.bypass("m", {})
    judged += feed(A, 12)
    assert degraded(judged, "p") == [True, True, True]
    assert degraded(judged, "q") == [False, True, True]
    assert [[v.bypassed for v in j.verdicts] for j in judged] == [[True, False], [False, False], [False, False]]


def test_several_monitors_tell_for_themselves() -> None:
    session, feed = session_of()
    other = Bypass("/other does too", 9)
    session.bypass("m", {A: ROGUE})
    session.bypass("n", {A: other, B: ROGUE})
    assert session.bypasses.of(0) == [ROGUE, other]
    session.bypass("m", {})
    assert session.bypasses.of(0) == [other]
    assert degraded(feed(A, 10)) == [True, True]
    session.bypass("n", {B: ROGUE})
    assert degraded(feed(A, 11)) == [False, True]


def test_both_halves_of_a_service_are_told_once() -> None:
    known = Bypasses({"/s": frozenset({0})})
    known.update("m", {StreamKey("/s", "request"): ROGUE, StreamKey("/s", "response"): ROGUE})
    assert known.of(0) == [ROGUE]
    assert known.properties == {0}
