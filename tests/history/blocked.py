"""A session in a database with its blocks, and what its rows come to by time, counted one by one."""

from __future__ import annotations

import random
import sqlite3
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec

from oracle_server.core.kinds import REVISION, TICK
from oracle_server.core.revisions import Change, Revision, Standing
from oracle_server.core.verdicts import Decision, Outcome
from oracle_server.history.blocks import BEFORE
from oracle_server.history.letters import LETTERS
from oracle_server.history.records import SessionRecord, StoredStep, restated, stored_revision
from oracle_server.history.sql.batch import Work, restating, write
from oracle_server.history.sql.blocks import BlockWriter, catching, forgetting
from oracle_server.history.sql.rows import session_row, step_row
from oracle_server.history.sql.schema import SESSION_COLUMNS
from oracle_server.history.sql.timeline import asked
from oracle_server.history.sqlite.migrations import migrate
from oracle_server.history.timeline import Question
from tests.history.making import opened, revision, step

OUTCOMES = [Outcome.CURRENTLY_TRUE] * 40 + [*Outcome]
GRAVITY = " -TtufF"
SIGNALS = ("/a:v", "/a:mode", "/b requests:v", "/c:v")


@dataclass
class Session:
    """A session that is written a batch at a time, as the history's writer does."""

    decides: Any = "publication"
    steps: list[StoredStep] = field(default_factory=list)
    database: sqlite3.Connection = field(default_factory=lambda: sqlite3.connect(":memory:", isolation_level=None))
    blocks: BlockWriter = field(default_factory=BlockWriter)
    last: int = 0

    def __post_init__(self) -> None:
        migrate(self.database)
        sql = f"INSERT INTO sessions ({','.join(SESSION_COLUMNS)}) VALUES ({','.join('?' * len(SESSION_COLUMNS))})"
        self.database.execute(sql, session_row(self.record))

    @property
    def record(self) -> SessionRecord:
        return opened()._replace(decides=self.decides)

    def add(self, steps: Sequence[StoredStep], *, kept: bool = True) -> None:
        """Write steps; where they are not `kept`, their transaction is rolled back."""
        self._transact([Work(1, "steps", [step_row(1, each) for each in steps])], kept=kept)
        if kept:
            self.steps += steps
            self.last += len(steps)

    def catch_up(self, *more: StoredStep) -> None:
        """Have blocks made that are missing, and write more steps with them."""
        self._transact([catching(1, lambda: None), Work(1, "steps", [step_row(1, each) for each in more])])
        self.steps += more
        self.last += len(more)

    def revise(self, standing: dict[int, Standing], *changes: Change) -> None:
        """Write a revision, after which other things stand at some positions."""
        self.last += 1
        made: Revision = revision(self.last, *(changes or (None,)), None, standing=standing)
        rows = [stored_revision(self.last, made)]
        self._transact([Work(1, "steps", [step_row(1, each) for each in rows], then=restating(1, [made]))])
        for position, stands in restated([made]).items():
            for i, each in enumerate(self.steps):
                if each.position == position:
                    self.steps[i] = msgspec.structs.replace(each, standing=stands.standing)
        self.steps += rows

    def forget(self, before: int) -> None:
        """Delete the steps before a position."""
        work = [Work(1, sql, values, always=True) for sql, values in forgetting(1, before)]
        self._transact(
            [*work, Work(1, "DELETE FROM steps WHERE session = ? AND position < ?", (1, before), always=True)]
        )
        self.steps = [each for each in self.steps if each.position >= before]

    def restart(self) -> None:
        """Go on as a new process does."""
        self.blocks = BlockWriter()

    def ask(self, question: Question) -> dict[str, Any]:
        try:
            found: dict[str, Any] = msgspec.json.decode(asked(self.database, self.record, question))
        finally:
            self.database.execute("COMMIT")
        return found

    @property
    def kept_blocks(self) -> list[Any]:
        return self.database.execute("SELECT * FROM blocks ORDER BY level, block").fetchall()

    def _transact(self, work: list[Work], *, kept: bool = True) -> None:
        self.database.execute("BEGIN")
        write(self.database, work)
        self.blocks.follow(self.database, work)
        if not kept:
            self.blocks.forget()
        self.database.execute("COMMIT" if kept else "ROLLBACK")


def counted(steps: Sequence[StoredStep], decides: str) -> list[tuple[int, StoredStep]]:
    """The steps that count, each with the time at which it is told."""
    found, latest = [], BEFORE
    for each in steps:
        if each.order == decides and each.step.event.stream.kind != REVISION:
            latest = max(latest, each.step.time)
            found.append((latest, each))
    return found


def check(found: dict[str, Any], steps: Sequence[StoredStep], decides: str) -> None:
    """Hold an answer against rows."""
    since, width, buckets = found["since"], found["width"], found["buckets"]
    assert since % width == 0
    assert str(width).strip("0") in ("1", "2", "5")
    rows = [(time, each) for time, each in counted(steps, decides) if since <= time < since + buckets * width]
    whats = [said(each) for _, each in rows]
    _check_counts(found, rows, whats)
    for i, name in enumerate("pq"):
        lane, degraded = found["lanes"][name], found["degraded"][name]
        near: defaultdict[int, set[str]] = defaultdict(set)
        doubts: defaultdict[int, set[str]] = defaultdict(set)
        for (time, _), what in zip(rows, whats, strict=True):
            bucket = (time - since) // width
            letter, mark = LETTERS[what.outcomes[i]], "1" if what.degraded[i] else "0"
            told = max(GRAVITY.index(lane[b]) for b in (max(0, bucket - 1), bucket))
            assert GRAVITY.index(letter) <= told, (bucket, lane)
            assert mark <= max(degraded[b] for b in (max(0, bucket - 1), bucket))
            for b in (bucket - 1, bucket):
                near[b].add(letter)
                doubts[b].add(mark)
        for bucket in range(buckets):
            assert lane[bucket] in near[bucket] | {" "}, (bucket, lane)
            assert degraded[bucket] in doubts[bucket] | {" "}


def _check_counts(found: dict[str, Any], rows: list[tuple[int, StoredStep]], whats: list[Standing]) -> None:
    asks = [each for _, each in rows if each.decision is not None]
    assert sum(found["steps"]) == len(rows)
    assert sum(found["late"]) == sum(each.step.late for _, each in rows)
    assert [sum(found["violations"][p]) for p in "pq"] == [sum(i in w.explanations for w in whats) for i in (0, 1)]
    assert sum(found["asked"]) == len(asks)
    assert sum(found["denied"]) == sum(each.decision.choice == "deny" for each in asks if each.decision)
    if found["hold"]:
        waits = [max(0, each.judged - each.step.event.arrived) for each in asks]
        assert max(found["hold"]["max"], default=0) == max(waits, default=0)
    counts: Counter[str] = Counter()
    lost: Counter[str] = Counter()
    values: defaultdict[str, list[Any]] = defaultdict(list)
    for _, each in rows:
        key = each.step.event.stream
        if key.kind != TICK:
            counts[str(key)] += 1
            lost[str(key)] += each.step.event.lost
            for signal, value in each.step.signals.items():
                values[f"{key}:{signal}"].append(value)
    assert {name: sum(of["count"]) for name, of in found["streams"].items()} == counts
    assert {name: sum(of["lost"]) for name, of in found["streams"].items()} == {name: lost[name] for name in counts}
    for name, of in found["signals"].items():
        numbers = [value for value in values[name] if not isinstance(value, str)]
        texts = {value for value in values[name] if isinstance(value, str)}
        assert sum(of["count"]) == len(numbers)
        assert [f([v for v in of[k] if v is not None], default=None) for f, k in ((min, "min"), (max, "max"))] == [
            f(numbers, default=None) for f in (min, max)
        ]
        assert {text for text in of["text"] if text is not None} <= texts
        assert any(of["several"]) or {text for text in of["text"] if text is not None} == texts


def said(each: StoredStep) -> Standing:
    """What stands at a step."""
    return each.standing or Standing(each.outcomes, each.degraded, each.explanations)


def some(rng: random.Random, first: int, count: int, at: int, *, both: bool = False) -> list[StoredStep]:
    """Steps from a position on, published from a time on: in bursts, with pauses, late, lost, denied, skewed ones."""
    made = []
    for position in range(first, first + count):
        at += rng.choice([0, 1, 10, 10, 10, 1000]) if rng.random() < 0.98 else rng.randrange(100_000)
        stream, kind = rng.choice([("/a", "topic"), ("/a", "topic"), ("/b", "request"), ("/c", "tick")])
        asked_ = kind == "request"
        one = step(
            position, stream=stream, kind=kind, stamp=max(0, at - rng.randrange(3000) * (rng.random() < 0.05)),  # type: ignore[arg-type]
            arrived=at + rng.randrange(500), outcomes=(rng.choice(OUTCOMES), rng.choice(OUTCOMES)),
            decision=rng.choice([None, Decision("allow", ()), Decision("deny", ("p",))]) if asked_ else None,
            violated=[i for i in (0, 1) if rng.random() < 0.02],
        )  # fmt: skip
        values: dict[str, Any] = {"v": rng.choice([position, -1.5, True, "Infinity"]), "mode": "auto"}
        if rng.random() < 0.01:
            values["mode"] = rng.choice(["manual", "x" * 200])
        event = msgspec.structs.replace(one.step.event, lost=rng.choice([0] * 30 + [3]))
        late, skewed = rng.random() < 0.01, rng.random() < 0.01
        made.append(
            msgspec.structs.replace(
                one,
                order=rng.choice(["publication", "arrival"]) if both else "publication",
                judged=at + rng.randrange(10_000),
                step=msgspec.structs.replace(one.step, event=event, signals=values, late=late, skewed=skewed),
            )
        )
    return made
