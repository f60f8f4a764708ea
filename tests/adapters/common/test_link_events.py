"""The link against a real WebSocket server: what is sent, asked and told."""

from __future__ import annotations

import logging
import queue
import threading
import time
from typing import TYPE_CHECKING, Any, List

import pytest
from oracle_adapter import Link, LinkError
from tests.adapters.common.links import PATIENCE, QUICK, answer_of, ask

if TYPE_CHECKING:
    from tests.adapters.common.conftest import News, Oracle


class TestSending:
    def test_events_of_many_threads(self, oracle: Oracle, link: Link) -> None:
        peer = oracle.accept()
        peer.attach()

        def robot(name: str) -> None:
            for number in range(500):
                assert link.send(name, "topic", number, {"n": number}, source="node", call=3)

        threads = [threading.Thread(target=robot, args=(f"/t{i}",)) for i in range(4)]
        for thread in threads:
            thread.start()
        events = peer.events(2000)
        for thread in threads:
            thread.join()
        assert [event["seq"] for event in events] == list(range(1, 2001))
        for name in ("/t0", "/t1", "/t2", "/t3"):
            numbers = [event["stamp"] for event in events if event["stream"] == name]
            assert numbers == list(range(500))
        assert events[0].keys() >= {"source", "call", "kind", "data", "ask"}

    def test_a_publisher_whose_name_is_longer_than_events_may_have_is_judged(
        self, oracle: Oracle, link: Link
    ) -> None:
        peer = oracle.accept()
        peer.attach()
        link.send("/a", "topic", 1, {}, source="/" + 300 * "n")
        [event] = peer.events(1)
        assert event["source"] == "/" + 254 * "n"

    def test_what_is_no_detail_is_refused(self, links: List[Link]) -> None:
        link = Link("ws://127.0.0.1:9", "uav1")
        links.append(link)
        misspelt: Any = {"sourc": "/node"}
        with pytest.raises(TypeError, match="sourc"):
            link.send("/a", "topic", 1, {}, **misspelt)
        with pytest.raises(TypeError, match="sourc"):
            link.ask("/a", "topic", 1, {}, decide_within=1.0, **misspelt)
        assert link.stats().queued == 0

    def test_it_never_waits(self, oracle: Oracle, news: News, links: List[Link]) -> None:
        held, sent, in_time = threading.Event(), threading.Event(), []

        def hold(record: Any) -> None:
            held.set()
            in_time.append(sent.wait(PATIENCE))
            news.violations.put(record)

        callbacks = {**news.callbacks(), "on_violation": hold}
        link = Link(oracle.url, "uav1", capacity=100, **callbacks)
        links.append(link)
        link.start()
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        peer.send("violation", n=0)
        assert held.wait(PATIENCE)  # now the link's own thread does nothing, and the peer neither
        peer.freeze()
        queued = [link.send("/a", "topic", n, "x" * 20_000) for n in range(120)]
        sent.set()
        assert news.violations.get(timeout=PATIENCE)["n"] == 0
        assert in_time == [True]
        assert queued == [True] * 100 + [False] * 20
        assert link.stats().lost == 20
        peer = oracle.accept()  # the old connection was found to be dead
        peer.attach()
        assert [event["stamp"] for event in peer.events(100)] == list(range(100))
        peer.send("ack", upto=100)
        peer.send("violation", n=1)
        news.violations.get(timeout=PATIENCE)  # and so the ack is read
        assert link.send("/a", "topic", 120, {})
        assert peer.events(1)[0]["lost"] == 20

    def test_what_is_too_large_is_told_at_once_to_people_and_to_the_server(
        self, oracle: Oracle, news: News, links: List[Link]
    ) -> None:
        link = Link(oracle.url, "uav1", **news.callbacks())
        links.append(link)
        link.start()
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        assert not link.send("/a", "topic", 1, {"x": "x" * (1 << 20)})  # the server hears nothing
        assert "too large for a frame" in news.errors.get(timeout=PATIENCE).message
        (told,) = peer.recv()["streams"]
        assert told["stream"] == "/a"
        assert told["trouble"].startswith("events are lost, the first one was too large")
        link.report("/a", "topic", trouble="its publishers differ")
        (both,) = peer.recv()["streams"]
        assert both["trouble"] == f"its publishers differ; {told['trouble']}"
        link.report("/a", "topic", trouble="")
        assert peer.recv()["streams"] == [told]

    def test_a_full_queue_is_told_where_there_is_no_server(
        self, oracle: Oracle, news: News, links: List[Link]
    ) -> None:
        peerless = Link(oracle.url, "uav1", capacity=1, **news.callbacks())
        links.append(peerless)
        oracle.stop()
        peerless.start()
        assert "unreachable" in str(news.errors.get(timeout=PATIENCE))
        assert [peerless.send("/a", "topic", n, {}) for n in range(2)] == [True, False]
        assert "the queue of 1 events is full" in str(news.errors.get(timeout=PATIENCE))

    def test_values_that_json_lacks(self, oracle: Oracle, link: Link) -> None:
        peer = oracle.accept()
        peer.attach()
        link.send("/a", "topic", None, {"x": float("nan"), "y": b"\x00", "z": 2**63})
        (event,) = peer.events(1)
        assert event["data"] == {"x": "NaN", "y": "AA==", "z": 2**63}
        assert "stamp" not in event

    @pytest.mark.parametrize(
        ("stamp", "data"),
        [(1, object()), (1.5, {}), ("1", {}), (lambda: 1.5, {}), (lambda: 1 / 0, {})],
    )
    def test_what_can_not_be_sent_is_refused_at_once(
        self, oracle: Oracle, link: Link, stamp: Any, data: Any
    ) -> None:
        peer = oracle.accept()
        peer.attach()
        with pytest.raises((TypeError, ZeroDivisionError)):
            link.send("/a", "topic", stamp, data)
        link.send("/a", "topic", 7, {})
        assert peer.events(1)[0]["seq"] == 1

    def test_a_clock_never_overtakes_a_stamp(
        self, oracle: Oracle, link: Link, often_switched: None
    ) -> None:
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)

        together = threading.Barrier(4)

        def robot() -> None:
            together.wait()
            for _ in range(1000):
                link.send("/s", "request", time.monotonic_ns, {})

        def clock() -> None:
            together.wait()
            for _ in range(1000):
                link.clock(lambda: [("/s", "request", time.monotonic_ns())])

        threads = [threading.Thread(target=work) for work in (robot, robot, robot, clock)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        link.clock([("/s", "request", 2**62)])
        frontier, events, ticks = 0, 0, 0
        while frontier < 2**62:
            frame = peer.recv()
            if frame["type"] == "clock":
                frontier = frame["stamps"][0]["stamp"]
                ticks += 1
            for event in frame.get("events", [frame] if frame["type"] == "event" else []):
                events += 1
                assert event["stamp"] >= frontier
        assert events == 3000
        assert ticks > 1


class TestAsking:
    def test_a_decision_and_what_was_done_with_it(self, oracle: Oracle, link: Link) -> None:
        peer = oracle.accept()
        peer.attach()
        future = ask(link)
        assert peer.events(1)[0]["ask"] is True
        assert not future.cancel()
        peer.send("decision", seq=1, decision="deny", denied_by=["p"], verdicts={"p": "false"})
        answer = answer_of(future)
        assert (answer.decision, answer.denied_by, answer.seq) == ("deny", ("p",), 1)
        link.handled(answer, False, "decision")
        assert peer.recv() == {"type": "outcome", "seq": 1, "passed": False, "why": "decision"}

    def test_silence_is_a_timeout_and_a_late_decision_nothing(
        self, oracle: Oracle, link: Link
    ) -> None:
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        started = time.monotonic()
        late, in_time = ask(link, within=0.1), ask(link, within=100 * PATIENCE)
        answer = answer_of(late)
        assert time.monotonic() - started >= 0.1
        assert answer.why == "timeout"
        assert not in_time.done()
        peer.events(2)
        peer.send("decision", seq=1, decision="allow")
        peer.send("decision", seq=2, decision="deny")
        assert answer_of(in_time).decision == "deny"
        assert answer_of(late) is answer
        assert link.stats().timeouts == 1

    def test_no_server_is_unavailable_and_history_has_it_later(
        self, oracle: Oracle, links: List[Link]
    ) -> None:
        oracle.stop()
        link = Link(oracle.url, "uav1", timing=QUICK, on_error=lambda error: None)
        links.append(link)
        link.start()
        answer = answer_of(ask(link, within=0.05))
        assert (answer.why, answer.seq) == ("unavailable", None)
        link.handled(answer, False, "unavailable")
        oracle.start()
        peer = oracle.accept()
        peer.attach(upcoming=5)
        assert peer.recv()["seq"] == 5
        assert peer.recv() == {"type": "outcome", "seq": 5, "passed": False, "why": "unavailable"}
        assert answer.seq == 5
        assert link.stats().unavailable == 1

    def test_an_ask_outlives_a_connection(self, oracle: Oracle, link: Link) -> None:
        peer = oracle.accept()
        peer.attach()
        future = ask(link)
        peer.events(1)
        peer.drop()
        peer = oracle.accept()
        peer.attach(upcoming=2)  # the server has it, and has decided meanwhile
        assert peer.events(1)[0]["seq"] == 1
        peer.send("decision", seq=1, decision="allow")
        assert answer_of(future).decision == "allow"

    def test_many_at_once(self, oracle: Oracle, link: Link) -> None:
        peer = oracle.accept()
        peer.attach()
        futures = [ask(link) for _ in range(100)]
        peer.events(100)
        for seq in range(100, 0, -1):
            peer.send("decision", seq=seq, decision="allow" if seq % 2 else "deny")
        decisions = [answer_of(future).decision for future in futures]
        assert decisions == ["allow", "deny"] * 50

    def test_many_handlings_are_sent_in_one_frame(self, oracle: Oracle, link: Link) -> None:
        peer = oracle.accept()
        peer.attach(limits={"max_outcomes": 4})
        futures = [ask(link) for _ in range(6)]
        peer.events(6)
        for seq in range(1, 7):
            peer.send("decision", seq=seq, decision="allow")
        answers = [answer_of(future) for future in futures]
        link.send("/a", "topic", None, {})  # what is told of them may come after it, not before
        for answer in answers:
            link.handled(answer, True, "decision")
        peer.events(1)
        told: List[int] = []
        while len(told) < 6:
            frame = peer.recv()
            outcomes = frame["outcomes"] if frame["type"] == "outcomes" else [frame]
            assert len(outcomes) <= 4
            told += [outcome["seq"] for outcome in outcomes]
        assert told == [1, 2, 3, 4, 5, 6]

    def test_a_decision_in_pieces(self, oracle: Oracle, link: Link) -> None:
        peer = oracle.accept()
        peer.attach()
        futures = [ask(link), ask(link)]
        peer.events(2)
        peer.send_in_pieces(['{"type":"decision",', '"seq":1,', '"decision":"deny"}'])
        peer.send("decision", seq=2, decision="allow")
        assert [answer_of(future).decision for future in futures] == ["deny", "allow"]

    def test_before_the_start_is_a_mistake(self, oracle: Oracle) -> None:
        with pytest.raises(LinkError, match="not started"):
            ask(Link(oracle.url, "uav1"))


class TestNews:
    def test_how_properties_stand_is_told_to_those_who_ask(
        self, oracle: Oracle, news: News, links: List[Link]
    ) -> None:
        links.append(Link(oracle.url, "uav1", on_verdicts=news.verdicts.put))
        links[0].start()
        peer = oracle.accept()
        assert peer.attach()["verdicts"] is True
        peer.send("verdicts", n=2, worst="false", properties={})
        told = news.verdicts.get(timeout=PATIENCE)
        assert told == {"n": 2, "worst": "false", "properties": {}}

    def test_an_event_of_an_action_names_its_goal(self, oracle: Oracle, links: List[Link]) -> None:
        links.append(Link(oracle.url, "uav1", features=["actions"]))
        links[0].start()
        peer = oracle.accept()
        assert peer.attach()["features"] == ["actions"]
        links[0].send("/dock", "reply", 5, {}, call=3, goal_id="9f2c", status="accepted")
        links[0].send("/dock", "cancel", 6, {}, call=4, goal_id="")
        reply, cancel = peer.events(2)
        assert (reply["call"], reply["goal_id"], reply["status"]) == (3, "9f2c", "accepted")
        assert cancel["goal_id"] == "", "of all goals"
        assert "status" not in cancel

    def test_what_was_revised_is_told_to_those_who_ask(
        self, oracle: Oracle, links: List[Link]
    ) -> None:
        told: queue.Queue[Any] = queue.Queue()
        links.append(Link(oracle.url, "uav1", on_revision=told.put))
        links[0].start()
        peer = oracle.accept()
        assert peer.attach()["features"] == ["revisions"]
        peer.send("revision", n=7, revises={"from": 2, "to": 4}, retracted=True)
        assert told.get(timeout=PATIENCE) == {
            "n": 7, "revises": {"from": 2, "to": 4}, "retracted": True,
        }  # fmt: skip

    def test_violations_and_refusals(self, oracle: Oracle, news: News, link: Link) -> None:
        peer = oracle.accept()
        peer.attach()
        link.send("/b", "topic", 1, {})
        peer.events(1)
        peer.send("error", code="unknown_stream", message="/b", seq=1, fatal=False)
        error = news.error()
        assert (error.code, error.seq, error.fatal) == ("unknown_stream", 1, False)
        peer.send("violation", n=4, property="p", outcome="false")
        assert news.violations.get(timeout=PATIENCE) == {
            "n": 4, "property": "p", "outcome": "false",
        }  # fmt: skip
        assert link.stats().refused == 1

    def test_errors_of_callbacks_stay_theirs(
        self, oracle: Oracle, links: List[Link], caplog: pytest.LogCaptureFixture
    ) -> None:
        def fail(*args: Any) -> None:
            raise ZeroDivisionError

        link = Link(oracle.url, "uav1", on_violation=fail, on_state=fail, on_error=fail)
        links.append(link)
        link.start()
        peer = oracle.accept()
        peer.attach()
        peer.send("violation", n=1)
        peer.send("error", code="busy", message="")
        future = ask(link)
        peer.events(1)
        peer.send("decision", seq=1, decision="allow")
        assert answer_of(future).decision == "allow"
        assert caplog.text.count("a callback of the link failed") == 3

    def test_errors_that_no_one_takes_are_logged(
        self, oracle: Oracle, links: List[Link], caplog: pytest.LogCaptureFixture
    ) -> None:
        caplog.set_level(logging.WARNING, "oracle_adapter")
        links.append(Link(oracle.url, "uav1"))
        links[0].start()
        peer = oracle.accept()
        peer.attach()
        peer.send("error", code="busy", message="a moment", fatal=False)
        future = ask(links[0])
        peer.events(1)
        peer.send("decision", seq=1, decision="allow")
        answer_of(future)
        assert "busy: a moment" in caplog.text
