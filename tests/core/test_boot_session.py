"""Streams whose stamps have a unit, or count from the robot's start, in a session."""

from __future__ import annotations

import pytest
from hypothesis import given

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.stamps import Stamp, stamp_in
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec
from tests.core.test_boot import MS, START, arrivals, many

SPEC = """
id: px4
streams:
  - {topic: /a, stamp: {field: timestamp, unit: us, epoch: boot}, signals: {v: msg.v}}
  - {topic: /b, stamp: {field: timestamp, unit: us, epoch: boot}, signals: {v: msg.v}}
  - {topic: /c, stamp: {field: timestamp, unit: us, epoch: boot}, signals: {v: msg.v}}
  - {topic: /d, stamp: {field: t, unit: ms}, signals: {w: msg.w}}
properties:
  - id: p
    formula: '{v} or {w}'
"""
READY = plan(parse_spec(SPEC, "px4.yaml").spec)


def opened() -> Session:
    session = Session(READY, make_engines(READY))
    session.attach("uav", READY.spec.by_key, START)
    return session


def event(topic: str, seq: int, arrived: int, data: dict[str, int], stamp: int | None = None) -> Event:
    return Event(StreamKey(topic, "topic"), "uav", seq, stamp, arrived, data)


@many
@given(arrivals(longest=150 * MS))
def test_streams_of_one_robot_are_judged_in_the_order_of_their_own_stamps(messages: list[tuple[str, int, int]]) -> None:
    session, judged = opened(), []
    for seq, (source, since, arrived) in enumerate(messages, 1):
        judged += session.ingest(event(f"/{source}", seq, arrived, {"timestamp": since // 1000, "v": 1}))
    judged += session.finish(session.now)
    raw = {seq: since for seq, (_, since, _) in enumerate(messages, 1)}
    order = [raw[j.step.event.seq] for j in judged if not j.step.late]
    assert order == sorted(order)
    assert len(judged) == len(messages)


def test_the_middlewares_time_fixes_the_clock_where_it_is_known() -> None:
    session = opened()
    session.ingest(event("/a", 1, START + 300 * MS, {"timestamp": 5_000_000, "v": 1}, stamp=START))
    session.ingest(event("/d", 2, START + 310 * MS, {"t": START // MS + 7, "w": 1}, stamp=1))
    session.ingest(event("/b", 3, START + 320 * MS, {"timestamp": 5_010_000, "v": 1}, stamp=START + 99 * MS))
    judged = session.finish(START + 330 * MS)
    assert [(j.step.event.seq, j.step.stamp) for j in judged] == [(1, START), (2, START + 7 * MS), (3, START + 10 * MS)]


def test_the_field_is_asked_for_and_adapters_read_no_stamp_of_it() -> None:
    assert READY.streams[StreamKey("/a", "topic")].fields == frozenset({"timestamp", "v"})
    assert READY.streams[StreamKey("/d", "topic")].fields == frozenset({"t", "w"})


@pytest.mark.parametrize(
    ("unit", "expected"), [(None, 7 * 10**9), ("s", 7 * 10**9), ("ms", 7 * 10**6), ("us", 7000), ("ns", 7)]
)
def test_a_number_counts_in_its_unit(unit: str | None, expected: int) -> None:
    assert stamp_in({"t": 7}, Stamp("t", unit)) == expected  # type: ignore[arg-type]
    assert stamp_in({"t": 7.0}, Stamp("t", unit)) == expected  # type: ignore[arg-type]
    assert stamp_in({"t": 7}, Stamp("t", unit, "boot")) is None  # type: ignore[arg-type]
