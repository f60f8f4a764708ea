"""Properties that oracles elsewhere judge, over real sockets to processes of their own."""

from __future__ import annotations

import asyncio
import json
import re
import signal
from collections.abc import Iterator
from itertools import count

import pytest
from websockets.asyncio.client import connect

from tests.processes import reserved_port
from tests.remote.conftest import Director, Oracles, Start, put, said, spec
from tests.whole.client import BASE, attached, make_clock, make_event
from tests.whole.harness import PATIENCE, Server

YES, NO, NOTHING = "currently_true", "currently_false", "unknown"


async def test_an_oracle_in_the_style_of_prolog(server: Server, oracles: Oracles, name: str) -> None:
    put(server, name, oracles.url("prolog"))
    async with attached(server, session=name, spec=name) as monitor:
        assert [s["fields"] for s in monitor.attached["streams"]] == [None, None], "oracles hear whole messages"
        await monitor.send(make_event(1, data={"v": 5}))
        assert (await monitor.ask(2, stream="/go", data={"v": 3}))["decision"] == "allow"
        await monitor.send(make_event(3, data={"v": 9}))
        decision = await monitor.ask(4, stream="/go", data={"v": 3})
        assert (decision["decision"], decision["denied_by"]) == ("deny", ["theirs"])
        await monitor.detach()
    assert await said(server, name, 4) == [(YES, False), (YES, False), (NO, False), (NO, False)]
    assert await said(server, name, 4, "ours") == [(YES, False)] * 4
    (violation,) = server.records(name, "violations")
    url = oracles.url("prolog")
    assert violation["explanation"]["text"].endswith(f"the oracle at {url}: answered false")


async def test_a_slow_oracle_is_never_behind_with_its_answers(server: Server, oracles: Oracles, name: str) -> None:
    put(server, name, oracles.url("slow?seconds=0.02"))
    async with attached(server, session=name, spec=name) as monitor:
        await monitor.send(*(make_event(n, data={"v": 6 if n == 7 else 1}) for n in range(1, 21)))
        await monitor.acked(20)
    assert await said(server, name, 20) == [(NO, False)] * 6 + [(YES, False)] * 14


async def test_one_question_at_a_time_is_under_way_and_flat(server: Server, director: Director, name: str) -> None:
    put(server, name, director.url)
    async with attached(server, session=name, spec=name) as monitor:
        first = await director.opened()
        data = {"v": 7, "header": {"stamp": {"sec": 3, "nanosec": 4}}, "time": "has no place there"}
        await monitor.send(make_event(1, at=500, data=data), make_event(2, at=600, data={}))
        asked, event = await director.asked()
        assert asked == first
        assert event.pop("time") > BASE / 10**9
        assert event == {"topic": "/a", "v": 7, "header": data["header"]}
        await director.say(first, "currently_false")  # nothing else was told in between
        asked, event = await director.asked()
        await director.say(first, "true")
        await monitor.acked(2)
        assert asked == first
    assert await said(server, name, 2) == [(NO, False), (YES, False)]


REPLIES = [
    ('{"verdict": true}', YES), ('{"verdict": "True"}', YES), ('{"ok": true}', YES), ("true", YES), ('"true"', YES),
    ("CURRENTLY_TRUE\n", YES), ('{"verdict": "false"}', NO), ('{"ok": false}', NO), ("false", NO), ("violated", NO),
    ('{"verdict": "Violation"}', NO), ('{"topic": "a", "time": 0, "v": 1, "verdict": "currently_false"}', None),
    ('{"topic": "/b", "verdict": "true"}', None), ('{"verdict": "unknown"}', NOTHING), ('{"verdict": "?"}', NOTHING),
    ('{"error": true}', NOTHING), ("{}", NOTHING), ("", NOTHING), ("null", NOTHING), ("1", NOTHING),
    ("[true]", NOTHING),
    ('{"verdict": 1}', NOTHING), ('{"verdict": "not true"}', NOTHING), ('{"verdict": ["true"]}', NOTHING),
    ('{"verdict": {"ok": true}}', NOTHING), ('{"verdict": "true", "ok": false}', NOTHING), ("true true", NOTHING),
    ('{"verdict": null, "ok": true}', NOTHING), ('{"verdict": "true"', NOTHING), ("[" * 10_000, NOTHING),
    ('{"verdict": "\\ud800"}', NOTHING), (f'{{"topic": "a", "time": 1{"0" * 400}, "verdict": true}}', None),
    ('{"verdict": true}', YES),
]  # fmt: skip
"""Replies, and what they are: None for what is about another event, after which the oracle is connected anew."""


async def test_only_a_clear_word_is_a_verdict(server: Server, director: Director, name: str) -> None:
    put(server, name, director.url)
    async with attached(server, session=name, spec=name) as monitor:
        connection = await director.opened()
        for number, (reply, outcome) in enumerate(REPLIES, 1):
            await monitor.send(make_event(number, data={"v": 1}))
            asked, _ = await director.asked()
            assert asked == connection
            await director.say(connection, reply)
            if outcome is None:
                assert await director.told("closed") == {"closed": connection}
                connection += 1
            await monitor.acked(number)
    outcomes = [outcome for outcome, _ in await said(server, name, len(REPLIES))]
    assert outcomes == [outcome or NOTHING for _, outcome in REPLIES]
    (theirs, _) = server.get(f"sessions/{name}")["properties"]
    assert theirs["unknown"] == outcomes.count(NOTHING)
    assert "was" not in theirs["complaint"][:20]


async def test_an_echo_of_the_message_is_no_verdict(server: Server, director: Director, name: str) -> None:
    """An oracle that only sends the event back has said nothing, whatever the message's own fields are called."""
    put(server, name, director.url)
    async with attached(server, session=name, spec=name) as monitor:
        await monitor.send(make_event(1, data={"ok": True, "verdict": "true"}))
        connection, event = await director.asked()
        await director.say(connection, json.dumps(event))
        await monitor.acked(1)
    assert await said(server, name, 1) == [(NOTHING, False)]


async def test_a_second_answer_is_not_taken_for_the_next_events(server: Server, director: Director, name: str) -> None:
    put(server, name, director.url)
    async with attached(server, session=name, spec=name) as monitor:
        await monitor.send(make_event(1, data={"v": 1}))
        first, _ = await director.asked()
        await director.say(first, "false")
        await monitor.acked(1)
        await director.say(first, "true")
        await monitor.send(make_event(2, data={"v": 1}))
        second, _ = await director.asked()
        assert second != first
        await director.say(second, "false")
        await monitor.acked(2)
    assert await said(server, name, 2) == [(NO, False), (NO, True)]


async def test_a_late_answer_is_not_taken_for_the_next_events(server: Server, director: Director, name: str) -> None:
    """The test may be late itself, and then tries again: in no case is there a yes."""
    put(server, name, director.url, timeout="2s")
    async with attached(server, session=name, spec=name) as monitor:
        await monitor.send(make_event(1, data={"v": 1}))
        hung, _ = await director.asked()
        await monitor.acked(1)
        assert await said(server, name, 1) == [(NOTHING, False)]
        for seq in range(2, 30):
            await monitor.send(make_event(seq, data={"v": 1}))
            asked, _ = await director.asked()
            assert asked != hung
            for number in range(hung, asked):
                await director.say(number, "true")
            await director.say(asked, "false")
            await monitor.acked(seq)
            outcomes = await said(server, name, seq)
            if outcomes[-1] == (NO, True):
                break
            hung = asked
    assert (NO, True) in outcomes
    assert {outcome for outcome, _ in outcomes} == {NOTHING, NO}
    assert await said(server, name, len(outcomes), "ours") == [(YES, False)] * len(outcomes)


async def test_an_oracle_that_hangs_denies_and_holds_up_no_other_session(
    server: Server, director: Director, name: str
) -> None:
    put(server, name, director.url, timeout="2s")
    put(server, f"{name}.b", director.url.replace("play", "nowhere"), timeout="1s")
    async with attached(server, session=name, spec=name) as monitor:
        await monitor.send(make_event(1, "/go", data={"v": 1}, ask=True))
        await director.asked()
        async with attached(server, session=f"{name}.b", spec=f"{name}.b") as other:
            await other.send(make_event(1, data={"v": 1}))
            await other.acked(1)
        decision = await monitor.expect("decision")
        assert (decision["decision"], decision["denied_by"]) == ("deny", ["theirs"])
        assert decision["verdicts"] == {"theirs": NOTHING, "ours": YES}
    (theirs, _) = server.get(f"sessions/{name}")["properties"]
    assert "did not answer within 2 s" in theirs["complaint"]


async def test_the_state_tells_which_oracle_is_waited_for(server: Server, director: Director, name: str) -> None:
    by_publication = spec(name, director.url).replace("by: arrival", "by: publication, max_delay: 800s")
    assert server.http.put(f"/api/v1/specs/{name}", content=by_publication).is_success
    asked = f"for the oracle at {director.url} of property theirs"
    async with attached(server, session=name, spec=name) as monitor:
        await monitor.send(make_clock("/go", at=15), make_event(1, at=10, data={"v": 1}))
        connection, _ = await director.asked()
        assert re.sub(r"\d+", "N", server.get(f"sessions/{name}")["waiting"], count=1) == f"held N ms {asked}"
        await monitor.send(make_event(2, at=20, data={"v": 1}))
        await server.holds(name, 1)
        first, second = server.get(f"sessions/{name}")["waiting"].split("; ")
        assert first.endswith(asked)
        assert re.fullmatch(r"held \d+ ms for /go of m1", second), "and what the order waits for"
        await director.say(connection, "true")
        await monitor.acked(1)
        assert ";" not in server.get(f"sessions/{name}")["waiting"]
        await monitor.send(make_clock("/go", at=25))
        await director.asked()
        await director.say(connection, "true")
        await monitor.acked(2)
    assert server.get(f"sessions/{name}")["waiting"] is None


async def test_a_dropped_connection_is_made_anew(server: Server, director: Director, name: str) -> None:
    put(server, name, director.url)
    async with attached(server, session=name, spec=name) as monitor:
        for seq, reply in enumerate(("true", None, "true"), 1):
            await monitor.send(make_event(seq, data={"v": 1}))
            connection, _ = await director.asked()
            await director.say(connection, reply)
            await monitor.acked(seq)
        assert connection == 2
        await director.say(connection, None)  # with nothing under way
        await director.told("closed")
        await monitor.send(make_event(4, data={"v": 1}))
        connection, _ = await director.asked()
        await director.say(connection, "true")
        await monitor.acked(4)
        assert connection == 3
    assert await said(server, name, 4) == [(YES, False), (NOTHING, False), (YES, True), (YES, True)]


async def test_an_oracle_that_is_away_stops_nothing_and_is_asked_once_it_is_there(
    server: Server, name: str, request: pytest.FixtureRequest
) -> None:
    place = reserved_port()
    request.addfinalizer(place.close)
    port = place.getsockname()[1]
    put(server, name, f"ws://127.0.0.1:{port}/prolog")
    async with attached(server, session=name, spec=name) as monitor:
        decision = await monitor.ask(1, stream="/go", data={"v": 1})
        assert decision["denied_by"] == ["theirs"]
        await monitor.send(make_event(2, data={"v": 7}))
        (violation,) = await monitor.violated(1)
        assert (violation["property"], violation["seq"]) == ("ours", 2)
        assert await said(server, name, 2) == [(NOTHING, False), (NOTHING, True)]
        oracles = Oracles(port)
        request.addfinalizer(oracles.stop)
        async with asyncio.timeout(PATIENCE):
            for seq in count(3):  # the server looks for it about once a second
                decision = await monitor.ask(seq, stream="/go", data={"v": 1})
                if decision["decision"] == "allow":
                    break
    assert (await said(server, name, seq))[-1] == (YES, True)
    server.said("an oracle fails")


async def test_a_session_that_is_closed_waits_for_what_was_asked(server: Server, director: Director, name: str) -> None:
    put(server, name, director.url)
    async with attached(server, session=name, spec=name) as monitor:
        await monitor.send(make_event(1, data={"v": 1}), make_event(2, data={"v": 1}))
        connection, _ = await director.asked()
        closing = asyncio.create_task(asyncio.to_thread(server.http.delete, f"/api/v1/sessions/{name}"))
        await director.say(connection, "true")
        await director.asked()
        await director.say(connection, "false")
        assert (await closing).is_success
        await monitor.closed()
    assert await said(server, name, 2) == [(YES, False), (NO, False)]
    assert await director.told("closed") == {"closed": connection}


async def test_a_restarted_server_keeps_what_was_said_and_asks_on(start: Start, director: Director) -> None:
    text = spec("x", director.url)
    server = start(text)
    async with attached(server, session="s", spec="x") as monitor:
        for seq, reply in enumerate(("true", "false", "hm"), 1):
            await monitor.send(make_event(seq, data={"v": 7}))
            connection, _ = await director.asked()
            await director.say(connection, reply)
        await monitor.acked(3)
    before, states = server.records("s"), server.get("sessions/s")["properties"]
    assert server.stop() == 0
    server = start(text)
    assert "differ" not in server.log
    assert server.records("s") == before
    again = server.get("sessions/s")["properties"]
    assert [{**p, "complaint": None} for p in again] == [{**p, "complaint": None} for p in states]
    async with attached(server, session="s") as monitor:
        await monitor.send(make_event(4, data={"v": 1}))
        connection, _ = await director.asked()
        await director.say(connection, "true")
        await monitor.acked(4)
    assert await said(server, "s", 4) == [(YES, False), (NO, False), (NOTHING, False), (YES, True)]


async def test_what_waits_when_a_server_is_killed_is_asked_about_again(start: Start, director: Director) -> None:
    text = spec("x", director.url)
    server = start(text)
    async with attached(server, session="s", spec="x") as monitor:
        await monitor.send(make_event(1, data={"v": 7}), make_event(2, data={"v": 8}))
        await director.asked()
        server.process.send(signal.SIGKILL)
        await monitor.closed()
    server.end()
    server = start(text)
    async with attached(server, session="s", spec="x") as monitor:
        assert monitor.attached["next"] == 1
        await monitor.send(make_event(1, data={"v": 7}), make_event(2, data={"v": 8}))
        for value, reply in ((7, "true"), (8, "false")):
            connection, event = await director.asked()
            assert event["v"] == value
            await director.say(connection, reply)
        await monitor.acked(2)
    assert [outcome for outcome, _ in await said(server, "s", 2)] == [YES, NO]


async def test_an_old_monitor_is_told_what_an_old_oracle_says(server: Server, director: Director, name: str) -> None:
    put(server, name, director.url)
    url = f"{server.url.replace('http', 'ws', 1)}/legacy/{name}"
    async with asyncio.timeout(PATIENCE), connect(url, proxy=None, open_timeout=PATIENCE, ping_interval=None) as socket:
        for number, (reply, outcome) in enumerate((("true", YES), ('{"verdict": false}', NO), ("hm", NOTHING)), 1):
            await socket.send(json.dumps({"topic": "a", "time": number + 0.25, "v": 1}))
            connection, event = await director.asked()
            assert event == {"topic": "/a", "time": event["time"], "v": 1}
            await director.say(connection, reply)
            answer = json.loads(await socket.recv())
            assert (answer["time"], answer["verdict"]) == (number + 0.25, outcome)
            assert answer.get("spec") == ("theirs" if outcome == NO else None)


@pytest.fixture(autouse=True)
def _healthy(request: pytest.FixtureRequest) -> Iterator[None]:
    yield
    if "server" in request.fixturenames:
        server = request.getfixturevalue("server")
        assert server.alive
        server.check_log()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
async def test_that_an_oracle_may_have_begun_anew_is_known_after_a_restart(
    start: Start, director: Director, number: signal.Signals
) -> None:
    """Also at an event that it does not hear, and so is not asked about."""
    text = spec("x", director.url).replace("guards: [/go]", "streams: [/a]", 1)
    server = start(text)
    async with attached(server, session="s", spec="x") as monitor:
        for seq in (1, 2):
            await monitor.send(make_event(seq, data={"v": 1}))
            connection, _ = await director.asked()
            await director.say(connection, "true")
            await monitor.acked(seq)
            if seq == 1:
                await director.say(connection, None)
                await director.told("closed")
        server.process.send(number)
        await monitor.closed()
    server.process.wait()
    server.end()
    server = start(text)
    async with attached(server, session="s") as monitor:
        await monitor.send(make_event(3, "/go", data={"v": 1}))
        await monitor.acked(3)
    assert await said(server, "s", 3) == [(YES, False), (YES, True), (YES, True)]
