"""Frames drawn at random, between and instead of sound ones."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.whole.client import Frame, Monitor, attached, connected, make_event, seqs
from tests.whole.harness import Server

pytestmark = pytest.mark.usefixtures("bystander")
some = settings(
    max_examples=60,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)

WORDS = st.sampled_from(
    [
        "type",
        "event",
        "events",
        "clock",
        "stamps",
        "outcome",
        "attach",
        "stream",
        "/a",
        "kind",
        "topic",
        "data",
        "v",
        "ask",
        "goal",
        "goal_id",
        "status",
    ]
)
NUMBERS = st.one_of(st.integers(), st.floats(), st.sampled_from([2**53, 2**63, 2**64, -(2**63) - 1, 10**400]))
VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, WORDS, st.text(max_size=8)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.one_of(WORDS, st.text(max_size=4)), inner, max_size=5)
    ),
    max_leaves=12,
)


def has_a_seq(value: Any) -> bool:
    """Whether a number could be used up by this."""
    if isinstance(value, dict):
        return "seq" in value or any(map(has_a_seq, value.values()))
    return isinstance(value, list) and any(map(has_a_seq, value))


def means_something(text: str) -> bool:
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return False
    return has_a_seq(value) or (isinstance(value, dict) and value.get("type") == "detach")


KINDS = st.sampled_from(["attach", "event", "events", "clock", "outcome", "hello"])
FRAMES = st.builds(lambda kind, rest: rest | {"type": kind}, KINDS, st.dictionaries(WORDS, VALUES, max_size=5))
BATCHES = st.builds(lambda events: {"type": "events", "events": events}, st.lists(VALUES, max_size=4))
NOISE = (
    st.one_of(st.text(max_size=30), VALUES.map(json.dumps), FRAMES.map(json.dumps), BATCHES.map(json.dumps))
    .map(lambda text: text.replace("1.0", "1e999"))
    .filter(lambda text: not means_something(text))
)


async def until_acked(monitor: Monitor, upto: int) -> list[Frame]:
    """All frames until an ack."""
    frames = []
    while monitor.upto < upto:
        frames.append(await monitor.recv())
    return frames


@some
@given(noise=st.lists(st.tuples(st.lists(NOISE, max_size=4), st.sampled_from([1, 11])), min_size=1, max_size=4))
async def test_noise_between_events_changes_nothing(
    server: Server, name: Callable[[], str], noise: list[tuple[list[str], int]]
) -> None:
    session = name()
    async with attached(server, session=session, spec="single") as monitor:
        for seq, (texts, v) in enumerate(noise, start=1):
            for text in texts:
                await monitor.send_text(text)
            await monitor.send(make_event(seq, at=seq, data={"v": v}))
        frames = await until_acked(monitor, len(noise))
        assert {f["type"] for f in frames} <= {"ack", "violation", "error"}
        assert not any("seq" in f for f in frames if f["type"] == "error")
    wanted = ["currently_true" if v == 1 else "currently_false" for _, v in noise]
    records = server.records(session)
    assert [(r["seq"], r["outcome"], r["degraded"]) for r in records] == [
        (seq, outcome, False) for seq, outcome in enumerate(wanted, start=1)
    ]


FIELDS = st.sampled_from(["type", "stream", "kind", "stamp", "data", "ask", "source", "call", "lost", "another"])
DELETED = object()


@some
@given(
    changes=st.lists(st.dictionaries(FIELDS, st.one_of(st.just(DELETED), VALUES), max_size=2), min_size=1, max_size=6),
    batched=st.booleans(),
)
async def test_each_event_is_either_judged_or_refused_by_its_number(
    server: Server, name: Callable[[], str], changes: list[dict[str, Any]], batched: bool
) -> None:
    events = []
    for seq, change in enumerate(changes, start=1):
        event = make_event(seq, at=seq, data={"v": 1}) | {"lost": 0} | change
        if not batched:
            event["type"] = "event"
        events.append(json.dumps({k: v for k, v in event.items() if v is not DELETED}))
    unreadable = {i for i, text in enumerate(events, start=1) if not is_plain_json(text)}
    session = name()
    async with attached(server, session=session, spec="single") as monitor:
        if batched:
            readable = [text for i, text in enumerate(events, start=1) if i not in unreadable]
            await monitor.send_text('{"type":"events","events":[' + ",".join(readable) + "]}")
        else:
            for text in events:
                await monitor.send_text(text)
        await monitor.send(make_event(len(events) + 1, data={"v": 1}))
        frames = await until_acked(monitor, len(events) + 1)
    refused = {f["seq"] for f in frames if f["type"] == "error" and "seq" in f}
    judged = seqs(server, session)
    assert len(judged) == len(set(judged))
    assert refused.isdisjoint(judged)
    assert refused | set(judged) | unreadable == set(range(1, len(events) + 2))
    assert len(judged) + 1 > len(changes) - len(refused) - len(unreadable)


def is_plain_json(text: str) -> bool:
    """Whether a text is JSON as the standard has it, with numbers that can be read."""
    try:
        json.loads(text, parse_constant=float.fromhex, parse_int=int)
    except ValueError:
        return False
    return "Infinity" not in text and "NaN" not in text


@some
@given(first=st.one_of(VALUES, FRAMES).map(json.dumps))
async def test_a_first_frame_that_is_no_sound_attach_ends_the_connection(server: Server, first: str) -> None:
    async with connected(server) as connection:
        await connection.send_text(first)
        frames, code = await connection.closed()
    assert code == 1008
    assert [f["type"] for f in frames] == ["error"]
