"""The server's numbers: right, bounded, and gone on with over a closed session."""

from __future__ import annotations

from prometheus_client.parser import text_string_to_metric_families

from tests.whole.client import attached, make_clock, make_event, make_events
from tests.whole.conftest import Starts
from tests.whole.harness import Server

Numbers = dict[tuple[str, tuple[tuple[str, str], ...]], float]


def numbers(server: Server) -> Numbers:
    response = server.http.get("/metrics")
    assert response.status_code == 200
    families = text_string_to_metric_families(response.text)
    return {(s.name, tuple(sorted(s.labels.items()))): s.value for family in families for s in family.samples}


def value(found: Numbers, name: str, **labels: str) -> float:
    return found[f"oracle_{name}", tuple(sorted(labels.items()))]


async def test_what_happens_is_counted(start: Starts) -> None:
    server = start()
    assert value(numbers(server), "events_total") == 0
    async with attached(server, session="s", spec="lamp", streams=["/light", "/switch"]) as monitor:
        await monitor.send(make_clock("/switch", 10**6, "response"))
        await monitor.send(make_event(1, "/light", 1, {"level": 300}), make_clock("/light", 10**6))
        request = {"stream": "/switch", "kind": "request", "data": {"switch_on": True}, "call": 1}
        assert (await monitor.ask(2, at=2, **request))["decision"] == "deny"
        await monitor.send(make_event(1, "/light", 1, {"level": 300}), make_event(5, "/nowhere", 3))
        await monitor.expect("error", seq=5)
        await monitor.acked(5)
        found = numbers(server)
        assert value(found, "duplicates_total") == 1
        assert value(found, "events_total") == 2
        assert value(found, "verdicts_total", outcome="currently_false") == 1
        assert sum(v for (name, _), v in found.items() if name == "oracle_verdicts_total") == 4
        assert value(found, "denied_total") == 1
        assert value(found, "refused_total") == 1
        assert value(found, "violations_total", spec="lamp", property="only_in_the_dark") == 1
        assert value(found, "violated", spec="lamp", property="only_in_the_dark") in (0, 1)
        assert value(found, "decision_seconds_count") == 1
        assert value(found, "decision_seconds_bucket", le="+Inf") == 1
        assert value(found, "hold_seconds_count") == 2
        assert (value(found, "sessions"), value(found, "monitors")) == (1, 1)
        assert value(found, "queue_depth", queue="order") == 0
        await monitor.detach()
    server.http.delete("/api/v1/sessions/s")
    after = numbers(server)
    totals = (f"{name}_total" for name in ("events", "denied", "duplicates", "refused", "attachments"))
    for name in (*totals, "hold_seconds_count"):
        assert value(after, name) == value(found, name), name
    assert (value(after, "sessions"), value(after, "monitors")) == (0, 0)


async def test_what_waits_is_told(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="slow") as monitor:
        await monitor.send(make_event(1, "/b", at=20), make_event(2, "/b", at=10, source="another"))
        await server.holds("s", 2)
        assert value(numbers(server), "queue_depth", queue="order") == 2
        await monitor.detach()


async def test_a_restored_session_is_not_counted_again(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_events(*(make_event(i, at=i, data={"v": 20 * (i % 2)}) for i in range(1, 21))))
        await monitor.acked(20)
        assert value(numbers(server), "events_total") == 20
        assert value(numbers(server), "violations_total", spec="single", property="a_is_small") > 0
    assert server.stop() == 0
    found = numbers(start())
    assert value(found, "violations_total", spec="single", property="a_is_small") == 0
    for name in ("events_total", "late_total", "lost_total", "engine_failures_total"):
        assert value(found, name) == 0, name


async def test_the_log_has_a_line_at_both_ends_of_a_connection_and_for_the_first_violations(start: Starts) -> None:
    server = start()
    before = len(server.log.splitlines())
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(*(make_event(i, at=i, data={"v": 20 * (i % 2)}) for i in range(1, 101)))
        await monitor.send(make_event(101, "/nowhere"))
        await monitor.acked(101)
        await monitor.detach()
    server.said("monitor disconnected")
    told = [line.split("]", 1)[1].split("  ")[0].strip() for line in server.log.splitlines()[before:]]
    violations = [line for line in told if line.startswith("violation: a_is_small does not hold at step ")]
    others = [line for line in told if line not in violations]
    assert 20 <= len(violations) < 50
    assert others[:2] == ["session opened", "monitor attached"]
    assert "monitor disconnected" in others[2:]
    assert all(line.startswith(("more violations are in the history", "monitor disconnected")) for line in others[2:])


async def test_labels_are_bounded(server: Server, session: str) -> None:
    async with attached(server, "a_monitor", session=session, spec="pair", streams=["/a"]) as monitor:
        await monitor.send(make_event(1, "/a", data={"v": 1}))
        text = server.http.get("/metrics").text
        assert session not in text
        assert "a_monitor" not in text
        assert "/a" not in text
        await monitor.detach()


async def test_violations_are_counted_by_property_and_those_of_now_are_told(start: Starts) -> None:
    server = start()
    pair = {"spec": "single", "property": "a_is_small"}
    async with attached(server, session="s", spec="single") as monitor:
        found = numbers(server)
        assert (value(found, "violations_total", **pair), value(found, "violated", **pair)) == (0, 0), "from the start"
        await monitor.send(*(make_event(i, at=i, data={"v": 20 * (i % 2)}) for i in range(1, 4)))
        await monitor.acked(3)
        async with attached(server, session="t", spec="single") as other:
            await other.send(make_event(1, data={"v": 20}))
            await other.acked(1)
            found = numbers(server)
            assert (value(found, "violations_total", **pair), value(found, "violated", **pair)) == (3, 2)
            assert value(found, "episodes_open", **pair) == 2
            await monitor.send(make_event(4, at=4, data={"v": 1}))
            await monitor.acked(4)
            found = numbers(server)
            assert (value(found, "violations_total", **pair), value(found, "violated", **pair)) == (3, 1)
            assert value(found, "episodes_open", **pair) == 1
    server.http.delete("/api/v1/sessions/s")
    server.http.delete("/api/v1/sessions/t")
    found = numbers(server)
    assert value(found, "episodes_open", **pair) == 0
    assert (value(found, "violations_total", **pair), value(found, "violated", **pair)) == (3, 0)
