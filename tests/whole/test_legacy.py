"""ROSMonitoring's own protocol: the conversations of tests/vectors/legacy byte for byte, and what is around them."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from oracle_server.attach.rosmonitoring import MONITOR, reply_text, verdict_of
from oracle_server.engines.native import NativeEngine
from tests.core.sessions import A, B, Feed, open_session, prop
from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, Server, failed

LAMP = "/legacy/lamp"
VECTORS = sorted((Path(__file__).parents[1] / "vectors" / "legacy").glob("*.json"))


@contextlib.asynccontextmanager
async def old_monitor(server: Server, path: str) -> AsyncIterator[ClientConnection]:
    url = server.url.replace("http", "ws", 1) + path
    async with asyncio.timeout(PATIENCE), connect(url, proxy=None, open_timeout=PATIENCE) as socket:
        yield socket


async def answer(socket: ClientConnection, text: str | bytes) -> str:
    await socket.send(text)
    reply = await socket.recv()
    assert isinstance(reply, str)
    return reply


def sessions(server: Server) -> dict[str, dict[str, Any]]:
    return {state["id"]: state for state in server.get("sessions")["items"]}


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
async def test_conversation(path: Path, server: Server) -> None:
    vector = json.loads(path.read_text())
    before = sessions(server)
    async with old_monitor(server, vector["path"]) as socket:
        for turn in vector["conversation"]:
            reply = await answer(socket, turn["monitor"])
            if "server" in turn:
                assert reply == turn["server"]
                continue
            value = json.loads(reply)
            assert value["verdict"] == "unknown"
            assert turn["error"] in value["error"]
        (session,) = sessions(server).keys() - before.keys()
        assert sessions(server)[session]["status"] == "open"
    records = await server.until(lambda: server.records(session), lambda found: len(found) == 2 * len(vector["judged"]))
    for record in records:
        assert {k: record[k] for k in ("stream", "kind", "seq", "stamp")} in vector["judged"]
        assert (record["order"], record["decision"], record["monitor"]) == ("arrival", None, "legacy")
    closed = await server.until(lambda: sessions(server)[session], lambda state: state["status"] == "closed")
    assert closed["counters"]["refused"] == len(vector["conversation"]) - len(vector["judged"])


async def test_each_connection_is_a_session_of_its_own(server: Server) -> None:
    before = sessions(server)
    wrong, right = '{"topic":"battery","time":1,"percentage":170}', '{"topic":"light","time":1,"level":3}'
    async with old_monitor(server, LAMP) as one, old_monitor(server, LAMP) as other:
        assert json.loads(await answer(one, wrong))["verdict"] == "currently_false"
        assert json.loads(await answer(other, right))["verdict"] == "currently_true"
        assert len(sessions(server)) == len(before) + 2


async def test_replies_come_in_the_order_of_the_frames(server: Server) -> None:
    frames = [json.dumps({"topic": "battery", "time": i, "percentage": i % 200}) for i in range(500)]
    async with old_monitor(server, LAMP) as socket:
        for frame in frames:
            await socket.send(frame)
        replies = [json.loads(await socket.recv()) for _ in frames]
    assert [reply["time"] for reply in replies] == list(range(500))
    assert [reply["verdict"] for reply in replies] == [
        "currently_false" if i % 200 > 100 else "currently_true" for i in range(500)
    ]


async def test_bytes_are_no_event_and_the_connection_lives(server: Server) -> None:
    async with old_monitor(server, LAMP) as socket:
        assert json.loads(await answer(socket, b"\x00"))["verdict"] == "unknown"
        assert json.loads(await answer(socket, '{"topic":"light","time":1,"level":3}'))["verdict"] == "currently_true"


async def test_half_a_surrogate_pair_is_no_event_and_takes_no_other_with_it(server: Server) -> None:
    """It could not be kept in the history, nor could what is kept with it."""
    before = sessions(server)
    async with old_monitor(server, LAMP) as socket:
        frames = ('{"topic":"light","time":1,"level":3}', '{"topic":"light","time":2,"level":"\\ud800"}')
        for frame in frames:
            await socket.send(frame)
        await socket.recv()
        assert "surrogates not allowed" in json.loads(await socket.recv())["error"]
        await answer(socket, frames[0])
        (session,) = sessions(server).keys() - before.keys()
        await server.until(lambda: server.records(session), lambda found: len(found) == 4)
    assert [r["seq"] for r in server.records(session)] == [1, 1, 3, 3]


def test_a_deadline_that_ran_out_before_an_event_is_not_said_of_it() -> None:
    answered_soon = prop("p", 'once[5ns:] {topic: "/a"} -> once {topic: "/b"}', time="seconds")
    session = open_session([answered_soon], attach={}, maker=lambda p: NativeEngine(p.formula, p.time), by="arrival")
    feed = Feed(session)
    feed(A, 10, monitor=MONITOR)
    judged = feed(B, 30, monitor=MONITOR)
    assert [j.step.event.stream.kind for j in judged] == ["tick", "topic"]
    assert verdict_of(judged, 2) == {"verdict": "true"}


FINAL = """
id: final
streams:
  - {topic: /a, signals: {ok: msg.ok}}
  - {topic: /b, signals: {ok: msg.ok}, action: filter}
properties:
  - {id: never_wrong, formula: "historically{ok}", guards: [/b]}
"""
WRONG = [('{"topic":"a","time":1,"ok":true}', "currently_true"), ('{"topic":"a","time":2,"ok":false}', "false"),
         ('{"topic":"b","time":3,"ok":true}', "false")]  # fmt: skip


@pytest.mark.parametrize("finals", [False, True])
async def test_a_monitor_that_only_logs_is_told_no_word_at_which_it_ends(start: Starts, finals: bool) -> None:
    """On a filter `false` stays: version 1 lets `currently_false` pass there with `warning: 2`."""
    server = start(ORACLE_LEGACY_FINALS=str(finals))
    assert server.http.put(
        "/api/v1/specs/final", content=FINAL, headers={"content-type": "application/yaml"}
    ).is_success
    async with old_monitor(server, "/legacy/final") as socket:
        said = [json.loads(await answer(socket, event))["verdict"] for event, _ in WRONG]
    assert said == ([word for _, word in WRONG] if finals else ["currently_true", "currently_false", "false"])


async def test_an_old_session_is_closed_after_a_restart_and_can_be_read(start: Starts) -> None:
    server = start(ORACLE_LEGACY="lamp", ORACLE_RESUME_WITHIN="0.2")
    async with old_monitor(server, "/") as socket:
        await answer(socket, '{"topic":"battery","time":1,"percentage":170}')
        (session,) = sessions(server)
        await server.until(lambda: server.records(session), len)
        before = server.records(session)
        server.process.send(signal.SIGKILL)
        with pytest.raises(ConnectionClosed):
            await socket.recv()
    server.end()
    again = start(ORACLE_LEGACY="lamp", ORACLE_RESUME_WITHIN="0.2")
    await again.until(lambda: sessions(again)[session]["status"], lambda status: status == "closed")
    assert again.records(session) == before


async def test_a_session_that_is_closed_over_http_ends_the_connection(server: Server) -> None:
    before = sessions(server)
    async with old_monitor(server, LAMP) as socket:
        await answer(socket, '{"topic":"light","time":1,"level":3}')
        (session,) = sessions(server).keys() - before.keys()
        assert server.http.delete(f"/api/v1/sessions/{session}").is_success
        with pytest.raises(ConnectionClosed):
            await socket.recv()
    server.said(f"legacy monitor disconnected .*session={session}\n")


@pytest.mark.parametrize(("path", "word"), [("/", "--legacy SPEC"), ("/legacy/nothing", "no spec 'nothing'")])
async def test_an_address_without_a_spec_is_refused_in_words(server: Server, path: str, word: str) -> None:
    with pytest.raises(InvalidStatus) as refused:
        async with old_monitor(server, path):
            pass
    assert refused.value.response.status_code == 404
    assert word in json.loads(refused.value.response.body or b"")["detail"]


def test_a_default_spec_that_is_not_on_hand_is_refused_at_the_start(tmp_path: Path) -> None:
    (tmp_path / "specs").mkdir()
    said = failed(
        "serve", "--specs", tmp_path / "specs", "--data-dir", tmp_path / "data", "--port", "0", "--legacy", "x"
    )
    assert "--legacy, or ORACLE_LEGACY: there is no spec 'x'" in said


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.sampled_from(["topic", "verdict", "spec", "error", "a"]) | st.text(), JSON, min_size=1))
def test_a_reply_is_the_event_and_our_words(event: dict[str, Any]) -> None:
    words = {"verdict": "currently_true"}
    reply = json.loads(reply_text(json.dumps(event), event, words))
    assert reply == {k: v for k, v in event.items() if k not in ("verdict", "spec", "error")} | words
