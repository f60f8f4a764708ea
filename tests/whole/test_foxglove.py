"""What Foxglove is shown of sessions as they go on."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from tests.foxglove.client import viewing
from tests.whole.client import BASE, attached, good, make_clock, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import Server, failed, run

MS = 10**6
LAMP = [("/light", "topic"), ("/battery", "topic"), ("/switch", "request"), ("/switch", "response")]


def offered(server: Server) -> str:
    """The address at which sessions are offered to Foxglove."""
    return server.said(r"offering sessions to Foxglove.*url=(\S+)")[1]


async def test_a_session_is_shown_as_it_goes_on(start: Starts) -> None:
    server = start(ORACLE_FOXGLOVE="0")
    async with (
        viewing(offered(server)) as viewer,
        attached(server, session="s", spec="lamp") as monitor,
    ):
        await viewer.until(lambda: len(viewer.topics) == 3)
        await monitor.send(*(make_clock(name, 10**6, kind) for name, kind in LAMP[:1] + LAMP[2:]))
        await monitor.send(make_event(1, "/battery", 0, {"percentage": 3}), make_clock("/battery", 1))
        names = {"/s/oracle/battery_is_plausible", "/s/oracle/only_in_the_dark"}
        await viewer.until(lambda: {seen.topic for seen in viewer.seen} >= names)  # the log was subscribed to before
        for seq, (at, level) in enumerate([(10, 101), (20, 5), (2_000, 6)], start=2):
            await monitor.send(make_event(seq, "/battery", at, {"percentage": level}))
        await monitor.send(make_clock("/battery", 10**6))
        request: dict[str, Any] = {"stream": "/switch", "kind": "request", "data": {"switch_on": True}, "call": 1}
        await monitor.send(make_event(5, at=2_001, ask=True, **request))
        await viewer.until(lambda: viewer.of("/s/switch/request"))
        await viewer.until(lambda: len(viewer.of("/s/oracle/log/episodes")) == 3)
        assert {
            "/s/battery", "/s/switch/request", "/s/oracle/only_in_the_dark", "/s/oracle/battery_is_plausible",
        } <= viewer.topics  # fmt: skip
        assert viewer.shape("/s/battery")[".signals.percentage"] == "number"
        values = [seen.data["value"] for seen in viewer.of("/s/oracle/battery_is_plausible")]
        assert [new for new, old in zip(values, [None, *values], strict=False) if new != old][-3:] == [1, -1, 1]
        told = {r["n"]: r for r in server.records("s")}
        for seen in viewer.of("/s/oracle/battery_is_plausible"):
            record = told[seen.data["n"]]
            assert (seen.data["outcome"], seen.time) == (record["outcome"], record["judged"])
        asked = viewer.of("/s/switch/request")[-1]
        assert asked.data["decision"] == "deny"
        assert [seen.data["level"] for seen in viewer.of("/s/oracle/log/episodes")] == [3, 2, 3]
        assert server.http.delete("/api/v1/sessions/s").status_code in (200, 202, 204)
        await viewer.until(lambda: not viewer.topics)


async def test_who_comes_later_is_told_how_it_stands(start: Starts) -> None:
    """And a server that was started anew shows the same."""
    server = start(ORACLE_FOXGLOVE="0")
    async with attached(server, session="s", spec="single") as monitor:
        await good(monitor, 1)
    for again in (False, True):
        if again:
            assert server.stop() == 0
            server = start(ORACLE_FOXGLOVE="0")
        async with viewing(offered(server), lambda topic: topic == "/s/oracle/a_is_small") as viewer:
            await viewer.heard()
            assert {seen.topic for seen in viewer.seen} == {"/s/oracle/a_is_small"}
            assert viewer.seen[-1].data["outcome"] == "currently_true"


async def test_a_signal_that_comes_later_is_in_the_schema_then(start: Starts) -> None:
    server = start(ORACLE_FOXGLOVE="0")
    async with viewing(offered(server)) as viewer, attached(server, session="s", spec="robust") as monitor:
        await monitor.send(make_clock("/b", 10**6), make_event(1, "/a", 1, {"v": "NaN"}), make_clock("/a", 1))
        await viewer.until(lambda: viewer.of("/s/a"))
        assert ".signals.v" not in viewer.shape("/s/a")
        await monitor.send(make_event(2, "/a", 2, {"v": 2}), make_clock("/a", 2))
        await viewer.until(lambda: viewer.of("/s/a")[-1].data["seq"] == 2)
        assert viewer.shape("/s/a")[".signals.v"] == "number"
        assert viewer.of("/s/a")[-1].data["signals"] == {"v": 2}
        assert viewer.of("/s/a")[-1].data["stamp"] == BASE + 2 * MS


async def test_a_client_that_does_not_read_delays_nobody(start: Starts) -> None:
    """What waits for it is bounded, and that it misses the rest is said."""
    server, last, long = start(ORACLE_FOXGLOVE="0"), 2_000, "x" * 20_000
    async with (
        viewing(offered(server)) as idle,
        viewing(offered(server)) as viewer,
        attached(server, session="s", spec="single") as monitor,
    ):
        await monitor.send(make_event(1, at=1, data={"v": long}))
        await idle.until(lambda: idle.of("/s/a"))
        for seq in range(2, last):
            await monitor.send(make_event(seq, at=seq, data={"v": long}))
        await viewer.until(lambda: viewer.of("/s/a") and viewer.of("/s/a")[-1].data["seq"] == last - 1)
        server.said("a client of Foxglove reads too slowly, and misses the oldest messages")
        assert (await monitor.ask(last, at=last, data={"v": 1}))["decision"] == "allow"
        assert await asyncio.to_thread(server.stop) == 0


async def test_it_is_refused_where_a_token_would_be_needed(start: Starts, tmp_path: Path) -> None:
    data = tmp_path / "data"
    assert run("token", "add", "reader", "--scope", "read", "--data-dir", data).returncode == 0
    ended = run("serve", "--data-dir", data, "--host", "0.0.0.0", "--insecure", "--foxglove", "0")
    assert ended.returncode == 2
    assert "Foxglove sends neither token nor certificate" in ended.stderr
    assert "--foxglove-insecure" in ended.stderr
    server = start(ORACLE_FOXGLOVE="0")
    server.said("whoever reaches Foxglove's port reads all sessions, without a token")
    assert server.stop() == 0
    server = start(ORACLE_HOST="0.0.0.0", ORACLE_INSECURE="1", ORACLE_FOXGLOVE="0", ORACLE_FOXGLOVE_INSECURE="1")
    assert "0.0.0.0" in offered(server)


async def test_it_ends_where_tokens_are_made_while_others_could_read(start: Starts, tmp_path: Path) -> None:
    server = start(ORACLE_HOST="0.0.0.0", ORACLE_INSECURE="1", ORACLE_FOXGLOVE="0")
    async with viewing(offered(server).replace("0.0.0.0", "127.0.0.1")) as viewer:
        await viewer.until(lambda: True)
        assert run("token", "add", "reader", "--scope", "read", "--data-dir", tmp_path / "data").returncode == 0
        server.said("nothing is offered to it any more")
        await viewer.socket.wait_closed()


def test_a_port_that_is_taken_is_said(start: Starts, tmp_path: Path) -> None:
    taken = offered(start(ORACLE_FOXGLOVE="0")).rpartition(":")[2]
    said = failed("serve", "--data-dir", tmp_path / "other", "--port", "0", "--foxglove", taken)
    assert f"--foxglove: can't listen at 127.0.0.1:{taken}: " in said


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    """Without the extra, an empty module stands in for what can't be imported."""
    (tmp_path / "foxglove.py").write_text("raise ImportError")
    said = failed("serve", "--data-dir", tmp_path / "data", "--port", "0", "--foxglove", "0", PYTHONPATH=str(tmp_path))
    assert "oracle-server[foxglove]" in said
