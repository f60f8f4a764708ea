"""What stands, what was said at first, and revisions: over HTTP and as a stream."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import msgspec
import pytest

from oracle_server.core.events import REVISIONS, Event, Step
from oracle_server.core.revisions import Change, Revision, Standing
from oracle_server.core.verdicts import Outcome
from oracle_server.sessions.live import LiveSession
from oracle_server.wire.outgoing import Record
from tests.api.conftest import Asked
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, event

ROOT = "/api/v1/sessions/s"


async def opened(asked: Asked) -> tuple[LiveSession, Kept]:
    """A session of one property, which is violated at the second of three events."""
    outbox = Kept()
    live, monitor = await asked.registry.attach(attach("s", "single"), outbox)
    for seq, v in enumerate((1, 11, 1), start=1):
        live.ingest(monitor, event(seq, "/a", v=v))
    live.ledger.write()
    await asked.registry.flush()
    return live, outbox


async def revise(asked: Asked, live: LiveSession, n: int, *, first: int, outcome: Outcome | None, **more: Any) -> None:
    """Let a late event come by which the verdict `first` is another one, as revision `n`."""
    event, whys = Event(REVISIONS, "", -n, 10, 20, None), {0: more["explanation"]} if "explanation" in more else {}
    change = msgspec.structs.replace(Change(n, "a_is_small", first, first, outcome, degraded=False), **more)
    live.ledger.add(
        [
            Revision(
                Step(event, {}, frozenset(), 10), None, "publication", live.clock.now(), (), None,
                first=n, changes=(change,), because=(event,), causes=1,
                standing={first: Standing((outcome,), (False,), whys)},
            )
        ]
    )  # fmt: skip
    live.ledger.write()
    await asked.registry.flush()


async def read(asked: Asked, path: str, **query: Any) -> list[tuple[int, str, bool]]:
    answer = await asked.http.get(f"{ROOT}/{path}", params=query)
    items = answer.json()["items"]
    for item in items:
        Record.model_validate(item)
    return [(item["n"], item["outcome"], item["violation"]) for item in items]


SAID = [(1, "currently_true", False), (2, "currently_false", True), (3, "currently_true", False)]
STANDS = [(1, "currently_true", False), (2, "currently_true", False), (3, "currently_true", False)]
REVISION = (4, "currently_true", False)


async def test_verdicts_are_told_as_is_asked(asked: Asked) -> None:
    live, _ = await opened(asked)
    for view in ("standing", "first", "all"):
        assert await read(asked, "verdicts", **{"as": view}) == SAID
    await revise(asked, live, 4, first=2, outcome=Outcome.CURRENTLY_TRUE, retracted=True)
    assert await read(asked, "verdicts") == await read(asked, "verdicts", **{"as": "standing"}) == STANDS
    assert await read(asked, "verdicts", **{"as": "first"}) == SAID
    assert await read(asked, "verdicts", **{"as": "all"}) == [*SAID, REVISION]
    assert await read(asked, "verdicts", outcome="currently_false") == []
    assert await read(asked, "violations") == []
    assert await read(asked, "violations", **{"as": "first"}) == [SAID[1]]
    assert await read(asked, "violations", **{"as": "all"}) == [SAID[1], REVISION]
    answer = await asked.http.get(f"{ROOT}/verdicts", params={"as": "all", "after": 3})
    (record,) = answer.json()["items"]
    assert (record["kind"], record["revises"], record["retracted"]) == ("revision", {"from": 2, "to": 2}, True)
    assert (await asked.http.get(f"{ROOT}/verdicts", params={"as": "was"})).status_code == 422


async def test_revisions_are_rows_and_no_steps(asked: Asked) -> None:
    live, _ = await opened(asked)
    before = asked.registry.counters.steps, dict(asked.registry.counters.outcomes)
    await revise(asked, live, 4, first=2, outcome=Outcome.CURRENTLY_TRUE, retracted=True)
    assert (asked.registry.counters.steps, dict(asked.registry.counters.outcomes)) == before
    assert [m.name for m in live.monitors.values()] == ["m"]


class Streamed:
    """The records of a stream, as they come."""

    def __init__(self, asked: Asked, **query: Any) -> None:
        self.found: list[tuple[int, str]] = []
        self._more = asyncio.Event()
        self._task = asyncio.create_task(self._read(asked, query))

    async def _read(self, asked: Asked, query: dict[str, Any]) -> None:
        scope_path = f"{ROOT}/stream"
        async for line in lines(asked, scope_path, query):
            if line.startswith('data: {"'):
                record = json.loads(line.removeprefix("data: "))
                self.found.append((record["n"], record["outcome"]))
                self._more.set()

    async def until(self, count: int) -> list[tuple[int, str]]:
        async with asyncio.timeout(PATIENCE):
            while len(self.found) < count:
                self._more.clear()
                await self._more.wait()
        return self.found

    def end(self) -> None:
        self._task.cancel()


async def lines(asked: Asked, path: str, query: dict[str, Any]) -> Any:
    """The lines of an answer that does not end, which httpx's transport for apps would wait for."""
    told: asyncio.Queue[bytes] = asyncio.Queue()
    encoded = "&".join(f"{name}={value}" for name, value in query.items()).encode()
    scope = {
        "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": "GET", "scheme": "http",
        "path": path, "raw_path": path.encode(), "query_string": encoded, "root_path": "",
        "headers": [(b"host", b"127.0.0.1")], "client": ("127.0.0.1", 1), "server": ("127.0.0.1", 80),
    }  # fmt: skip

    async def receive() -> dict[str, Any]:
        await asyncio.Event().wait()
        return {}

    async def send(message: Any) -> None:
        told.put_nowait(message.get("body", b""))

    answering = asyncio.ensure_future(asked.guarded(scope, receive, send))
    try:
        rest = b""
        while True:
            *whole, rest = (rest + await told.get()).split(b"\n")
            for line in whole:
                yield line.decode()
    finally:
        answering.cancel()


@pytest.mark.parametrize(
    ("view", "then"), [("standing", [(4, "currently_true")]), ("all", [(4, "currently_true")]), ("first", [])]
)
async def test_who_follows_is_told_of_revisions_as_they_come(
    asked: Asked, view: str, then: list[tuple[int, str]]
) -> None:
    live, _ = await opened(asked)
    stream = Streamed(asked, **{"as": view})
    assert await stream.until(3) == [(n, outcome) for n, outcome, _ in SAID]
    await revise(asked, live, 4, first=2, outcome=Outcome.CURRENTLY_TRUE, retracted=True)
    live.ingest(live.monitors["m"], event(4, "/a", v=2))
    live.ledger.write()
    assert (await stream.until(4 + len(then)))[3:] == [*then, (5, "currently_true")]
    stream.end()


async def test_who_begins_to_follow_later_reads_what_stands_and_why(asked: Asked) -> None:
    live, _ = await opened(asked)
    await revise(asked, live, 4, first=2, outcome=Outcome.CURRENTLY_TRUE, retracted=True)
    stream = Streamed(asked)
    assert await stream.until(4) == [*[(n, outcome) for n, outcome, _ in STANDS], (4, "currently_true")]
    stream.end()


async def explained(asked: Asked, n: int, **query: str) -> tuple[int, Any]:
    answer = await asked.http.get(f"{ROOT}/verdicts/{n}/explanation", params=query)
    return answer.status_code, answer.json()


async def test_a_violation_that_appeared_is_explained_as_it_stands(asked: Asked) -> None:
    live, _ = await opened(asked)
    _, second = await explained(asked, 2)
    why = second["explanation"] | {"text": "as the revision says"}
    violation = {"outcome": Outcome.CURRENTLY_FALSE, "violation": True, "explanation": why}
    await revise(asked, live, 4, first=3, **violation)
    for n in (3, 4):
        assert (await explained(asked, n))[1]["explanation"] == why
    _, first = await explained(asked, 3, **{"as": "first"})
    assert (first["outcome"], first["violation"]) == ("currently_true", False)
    assert first["explanation"]["text"].startswith("a_is_small holds at step 3 ")


async def test_what_is_no_verdict_of_a_step_is_not_explained(asked: Asked) -> None:
    live, _ = await opened(asked)
    await revise(asked, live, 4, first=2, outcome=Outcome.CURRENTLY_TRUE, retracted=True)
    await revise(asked, live, 5, first=3, outcome=None)
    status, told = await explained(asked, 4)
    assert (status, told["detail"]) == (409, "verdict 4 is a revision; ask why verdict 2 stands as it does")
    status, told = await explained(asked, 3)
    assert (status, "does not stand" in told["detail"]) == (409, True)
    assert (await explained(asked, 3, **{"as": "first"}))[0] == 200
    assert (await explained(asked, 6))[0] == 404
