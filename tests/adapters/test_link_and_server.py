"""The link against the real server: events, asks and outcomes."""

from __future__ import annotations

import asyncio
import contextlib
from queue import Queue

from oracle_adapter import Link, should_pass

from tests.processes import reserved_port
from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE

STAMP = 1_732_147_200 * 10**9
EVENTS = 300


async def test_events_and_decisions_are_in_the_history_each_once(start: Starts) -> None:
    server = start()
    link = Link(server.url, "m1", spec="single", session="s", streams=["/a"])
    with link:
        link.wait_attached(PATIENCE)
        for i in range(EVENTS):
            assert link.send("/a", "topic", STAMP + i, {"v": 1})
        answer = link.ask("/a", "topic", STAMP + EVENTS, {"v": 99}, decide_within=PATIENCE).result(PATIENCE)
        assert answer.why == "decision"
        link.handled(answer, *should_pass(answer, "deny"))
        assert link.close(PATIENCE)
    records = server.records("s")
    first = [r for r in records if r["property"] == records[0]["property"]]
    assert [r["seq"] for r in first] == list(range(1, EVENTS + 2))
    assert (first[-1]["decision"], first[-1]["passed"]) == (answer.decision, answer.decision == "allow")
    assert link.stats().lost == 0


async def test_who_leaves_is_told_before_of_all_that_was_violated(start: Starts) -> None:
    """The last violations came behind `detached`, and were heard by nobody."""
    told: list[object] = []
    with Link(start().url, "m1", spec="single", session="s", streams=["/a"], on_violation=told.append) as link:
        link.wait_attached(PATIENCE)
        assert link.send("/a", "topic", STAMP, {"v": 99})
        assert link.close(PATIENCE)
    assert len(told) == 1


def test_a_wrong_path_is_told_and_no_matter_of_tokens(start: Starts) -> None:
    """As behind a proxy that leaves its own path before that of the server: it was HTTP 403, at which a link ends."""
    server, told = start(), Queue[str]()
    with Link(f"{server.url}/oracle", "m1", spec="single", on_error=lambda error: told.put(str(error))):
        assert "HTTP 404: no monitor attaches at `/oracle/api/v1/attach`" in told.get(timeout=PATIENCE)


class Cable:
    """A way to the server that can be cut and mended."""

    def __init__(self, url: str) -> None:
        self._target = int(url.rpartition(":")[2])
        self._ends: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._listener: asyncio.Server | None = None
        self.loses = False
        """Whether what is sent now gets lost on the way, either way."""
        self._place = reserved_port()
        self.port = self._place.getsockname()[1]

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    async def mend(self) -> None:
        self._listener = await asyncio.start_server(self._carry, "127.0.0.1", self.port)

    async def cut(self) -> None:
        assert self._listener is not None
        self._listener.close()
        for end in self._ends:
            end.transport.abort()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def remove(self) -> None:
        await self.cut()
        self._place.close()

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        other_reader, other_writer = await asyncio.open_connection("127.0.0.1", self._target)
        self._ends |= {writer, other_writer}
        for source, sink in ((reader, other_writer), (other_reader, writer)):
            task = asyncio.ensure_future(self._copy(source, sink))
            self._tasks.add(task)

    async def _copy(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while data := await source.read(65536):
                if self.loses:
                    continue
                sink.write(data)
                await sink.drain()


async def test_a_session_of_ones_own_is_made_anew_after_a_long_outage(start: Starts) -> None:
    server = start(ORACLE_RESUME_WITHIN="0.1")
    cable = Cable(server.url)
    await cable.mend()
    link = Link(cable.url, "m1", spec="single", streams=["/a"], on_error=lambda error: None)
    link.start()
    first = (await asyncio.to_thread(link.wait_attached, PATIENCE)).session
    link.send("/a", "topic", STAMP, {"v": 1})
    await server.until(lambda: link.stats().acked, lambda acked: acked == 1)
    await cable.cut()
    await server.until(lambda: server.get(f"sessions/{first}")["status"], lambda status: status == "closed")
    link.send("/a", "topic", STAMP + 1, {"v": 2})
    await cable.mend()
    await server.until(lambda: link.stats().acked, lambda acked: acked == 2)
    second = (await asyncio.to_thread(link.wait_attached, PATIENCE)).session
    assert await asyncio.to_thread(link.close, PATIENCE)
    await cable.remove()
    assert second != first
    assert [{r["stamp"] for r in server.records(session)} for session in (first, second)] == [{STAMP}, {STAMP + 1}]
    assert link.stats().lost == 0


async def test_what_was_on_its_way_while_another_process_took_the_name_is_told_as_lost(start: Starts) -> None:
    """Its numbers are those of the other one's events: acks of these let it forget its own, and nobody missed them."""
    server = start()
    cable = Cable(server.url)
    await cable.mend()
    told = Queue[str]()
    link = Link(cable.url, "m1", spec="single", session="s", on_error=lambda error: told.put(error.code))
    link.start()
    await asyncio.to_thread(link.wait_attached, PATIENCE)
    link.send("/a", "topic", STAMP, {"v": 1})
    await server.until(lambda: link.stats().acked, lambda acked: acked == 1)
    cable.loses = True
    for i in range(1, 4):
        link.send("/a", "topic", STAMP + i, {"v": 1})
    await server.until(lambda: link.stats().sent, lambda sent: sent == 4)
    await cable.cut()

    def take_the_name() -> None:
        with Link(server.url, "m1", spec="single", session="s") as other:
            other.wait_attached(PATIENCE)
            other.send("/a", "topic", STAMP + 10, {"v": 1})
            assert other.close(PATIENCE)

    await asyncio.to_thread(take_the_name)
    cable.loses = False
    await cable.mend()
    await server.until(lambda: link.stats().reconnects, lambda reconnects: reconnects == 1)
    link.send("/a", "topic", STAMP + 20, {"v": 1})
    assert await asyncio.to_thread(link.close, PATIENCE)
    await cable.remove()
    records = {record["stamp"] - STAMP: record["degraded"] for record in server.records("s")}
    assert records == {0: False, 10: False, 2: True, 3: True, 20: True}
    assert link.stats().lost == 1
    while told.get(timeout=PATIENCE) != "lost":  # that the server is away may be told before
        pass


def test_a_second_link_of_a_program_by_a_name_that_is_in_use_is_refused(start: Starts) -> None:
    """The first one ended, and what the second one sent by numbers of that one's events was acked and not judged."""
    server, told = start(), Queue[str]()
    with Link(server.url, "m1", spec="single", session="s") as first:
        first.wait_attached(PATIENCE)
        with Link(server.url, "m1", spec="single", session="s", on_error=lambda error: told.put(error.code)):
            assert told.get(timeout=PATIENCE) == "monitor_taken"
        assert first.send("/a", "topic", STAMP, {"v": 1})
        assert first.close(PATIENCE)
