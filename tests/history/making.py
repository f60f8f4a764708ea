"""Sessions and steps for histories."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
from hypothesis import strategies as st

from oracle_server.core.events import REVISIONS, Event, Step, StreamKey
from oracle_server.core.kinds import StepKind
from oracle_server.core.records import ExplanationRecord, VerdictRecord
from oracle_server.core.revisions import Change, Revision, Standing
from oracle_server.core.verdicts import Decision, Outcome
from oracle_server.history import pages
from oracle_server.history.port import History
from oracle_server.history.query import Query
from oracle_server.history.records import SessionRecord, StoredStep
from oracle_server.history.views import Doubts

PROPERTIES = ("p", "q")


def opened(number: int = 1, name: str = "s", *, private: bool = False) -> SessionRecord:
    """A session of two properties."""
    return SessionRecord(number, name, "spec", "id: spec", "digest", PROPERTIES, private, 1000 + number, None)


def step(
    position: int,
    *,
    monitor: str = "m",
    seq: int | None = None,
    stream: str = "/a",
    kind: StepKind = "topic",
    stamp: int | None = None,
    arrived: int | None = None,
    outcomes: Sequence[Outcome] = (Outcome.CURRENTLY_TRUE, Outcome.CURRENTLY_TRUE),
    decision: Decision | None = None,
    violated: Sequence[int] = (),
    number: int | None = 0,
    skewed: bool = False,
) -> StoredStep:
    """A step; where nothing else is named, its numbers follow from its position."""
    tick = kind == "tick"
    event = Event(
        StreamKey("" if tick else stream, kind), "" if tick else monitor, position if seq is None else seq,
        10 * position if stamp is None else stamp, 10 * position if arrived is None else arrived, None,
        ask=decision is not None,
    )  # fmt: skip
    assert event.stamp is not None
    made = Step(event, {"v": position}, frozenset(), event.stamp, skewed, skipped=number is None)
    explanations: dict[int, ExplanationRecord] = {i: explanation(made, PROPERTIES[i]) for i in violated}
    return StoredStep(
        position, "publication", position if number == 0 else number, made, 0, 100 * position, decision,
        tuple(outcomes), (False, True), explanations,
    )  # fmt: skip


def explanation(made: Step, name: str) -> ExplanationRecord:
    """Why a property does not hold at a step."""
    stream, kind = made.event.stream
    return {
        "text": f"{name} does not hold",
        "formula": "false",
        "event": {
            "stream": stream, "kind": kind, "stamp": made.stamp, "monitor": made.event.monitor, "seq": made.event.seq,
            "signals": {},
        },
    }  # fmt: skip


def revision(
    position: int, *changes: Change | None, standing: Mapping[int, Standing] | None = None, stamp: int = 5
) -> Revision:
    """A revision that is made at a position, because of one late event."""
    late = Event(StreamKey("/a", "topic"), "m", 1000 + position, stamp, 10 * position, {"large": "data"})
    event = Event(REVISIONS, "", -position, stamp, 10 * position, None)
    return Revision(
        Step(event, {}, frozenset(), stamp, skipped=True), None, "publication", 100 * position, (), None,
        first=(position - 1) * len(PROPERTIES) + 1, changes=changes, because=(late,), causes=1, standing=standing or {},
    )  # fmt: skip


def asked_for(found: Sequence[VerdictRecord], query: Query) -> list[VerdictRecord]:
    """Of all records, in their order, those that a query asks for, by its words."""
    wanted = []
    for record in found:
        n = record["n"]
        time = record["arrived"] if record["skewed"] else record["stamp"]
        behind = query.after is None or (n > query.after if query.order == "asc" else n < query.after)
        if (
            behind
            and (not query.properties or record["property"] in query.properties)
            and (not query.outcomes or record["outcome"] in query.outcomes)
            and (query.stream is None or record["stream"] == query.stream)
            and (query.since is None or time >= query.since)
            and (query.until is None or time <= query.until)
            and (not query.violations or record["violation"] or record.get("retracted", False))
        ):
            wanted.append(record)
    return wanted if query.order == "asc" else wanted[::-1]


async def find(
    history: History, session: SessionRecord, query: Query, doubts: Doubts | None = None
) -> tuple[list[VerdictRecord], int | None]:
    """A page of verdict records, and the `n` to go on after."""
    found, after = await pages.find(history, session, query, doubts)
    records: list[VerdictRecord] = [msgspec.json.decode(text) for _, text in found]
    assert [record["n"] for record in records] == [n for n, _ in found]
    return records, after


async def add(history: History, *steps: StoredStep, session: int = 1) -> None:
    """Keep steps, and wait until they are committed."""
    history.append(session, steps, lambda: None)
    await history.flush()


OUTCOMES = st.tuples(st.sampled_from(Outcome), st.sampled_from(Outcome))
DECISIONS = st.sampled_from([None, Decision("allow", ()), Decision("deny", ("p",))])


@st.composite
def some_steps(draw: st.DrawFn) -> list[StoredStep]:
    """Steps as a session may have judged them, in their sequence."""
    count = draw(st.integers(0, 12))
    return [
        step(
            position,
            monitor=draw(st.sampled_from("mn")),
            seq=position,
            stream=draw(st.sampled_from(["/a", "/b"])),
            kind=draw(st.sampled_from(["topic", "request", "tick"])),
            stamp=draw(st.integers(0, 60)),
            arrived=draw(st.integers(0, 60)),
            outcomes=draw(OUTCOMES),
            decision=draw(DECISIONS),
            violated=sorted(draw(st.sets(st.sampled_from([0, 1])))),
            number=draw(st.sampled_from([None, 0])),
            skewed=draw(st.booleans()),
        )
        for position in range(1, count + 1)
    ]
