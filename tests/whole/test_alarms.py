"""Alarms of a real server at a real receiver: one for each property and episode, and never in a decision's way."""

from __future__ import annotations

from pathlib import Path

from tests.remote.receiving import SECRET, receiving
from tests.whole.client import BASE, attached, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import failed
from tests.whole.test_metrics import numbers, value

SMALL, BIG = {"v": 1}, {"v": 11}


def write(folder: Path, url: str, *what: str) -> str:
    path = folder / "alarms.yaml"
    path.write_text(f"alarms:\n  - url: {url}\n    what: [{', '.join(what)}]\n    secret: {{env: HOOK}}\n")
    return str(path)


async def test_an_episode_is_one_alarm_and_the_end_of_a_session_another(start: Starts, tmp_path: Path) -> None:
    with receiving() as receiver:
        receiver.answers = [503]
        server = start(ORACLE_ALARMS=write(tmp_path, receiver.url, "violation", "session_ended"), HOOK=SECRET)
        async with attached(server, session="s", spec="single") as monitor:
            for seq, (at, data) in enumerate([(0, BIG), (200, SMALL), (400, BIG), (600, SMALL), (5000, BIG)], start=1):
                await monitor.send(make_event(seq, at=at, data=data))
            await monitor.acked(5)
            await monitor.detach()
        server.http.delete("/api/v1/sessions/s")
        first, again, second, ended = (receiver.take()[1] for _ in range(4))
        assert again == first, "it was tried again"
        stamps = [(alarm["alarm"], alarm["n"], alarm["step"], alarm["stamp"] - BASE) for alarm in (first, second)]
        assert stamps == [("violation", 1, 1, 0), ("violation", 5, 5, 5 * 10**9)]
        assert (first["session"], first["spec"], first["property"]) == ("s", "single", "a_is_small")
        assert first["text"] == server.records("s", "violations")[0]["explanation"]["text"]
        assert (ended["alarm"], ended["because"]) == ("session_ended", "by request")
        assert ended["violations"] == {"a_is_small": 3}
        await server.until(lambda: value(numbers(server), "alarms_sent_total"), lambda sent: sent == 3)
        assert value(numbers(server), "alarms_dropped_total") == 0
        assert SECRET not in server.log


async def test_what_is_final_is_told_once_over_a_restart_too(start: Starts, tmp_path: Path) -> None:
    with receiving() as receiver:
        file = write(tmp_path, receiver.url, "final", "degraded")
        server = start(ORACLE_ALARMS=file, HOOK=SECRET)
        async with attached(server, session="s", spec="pair", streams=["/a"]) as monitor:
            await monitor.send(make_event(1, "/a", at=0, data={"v": 0}), make_event(2, "/a", at=1, data={"v": 1}))
            await monitor.acked(2)
            _, alarm = receiver.take()
            assert (alarm["alarm"], alarm["property"], alarm["outcome"]) == ("final", "never_zero", "false")
            assert server.stop() == 0
        server = start(ORACLE_ALARMS=file, HOOK=SECRET)
        async with attached(server, session="s", spec="pair", streams=["/a"]) as monitor:
            await monitor.send(make_event(5, "/a", at=3000, data={"v": 1}))
            await monitor.acked(5)
            (state,) = [each for each in server.get("sessions")["items"] if each["id"] == "s"]
            told = {(alarm["alarm"], alarm["property"]) for _, alarm in (receiver.take() for _ in state["properties"])}
        assert told == {("degraded", each["id"]) for each in state["properties"]}
        assert receiver.came.qsize() == 0


async def test_decisions_are_made_while_the_receiver_answers_nothing(start: Starts, tmp_path: Path) -> None:
    with receiving() as receiver:
        receiver.held.clear()
        server = start(ORACLE_ALARMS=write(tmp_path, receiver.url, "violation"), HOOK=SECRET)
        async with attached(server, session="s", spec="single") as monitor:
            for seq in range(1, 41):
                await monitor.send(make_event(seq, at=1500 * seq, data=BIG if seq % 2 else SMALL))
            await monitor.acked(40)
            assert len(server.records("s", "violations")) == 20
            found = numbers(server)
            assert (value(found, "alarms_sent_total"), value(found, "queue_depth", queue="alarms")) == (0, 20)
            await monitor.detach()
        receiver.take()
        assert server.stop() == 0, "and it stops beside it"
        assert receiver.came.qsize() == 0, "one at a time"
        assert "alarms are not sent any more" in server.log


def test_a_file_with_a_mistake_keeps_the_server_from_starting(tmp_path: Path) -> None:
    file = write(tmp_path, "http://127.0.0.1:1", "violations")
    line = failed("serve", "--data-dir", tmp_path / "data", "--port", "0", ORACLE_ALARMS=file, HOOK=SECRET)
    assert "alarms.yaml:3:12: `what` must be a list of violation, final" in line
