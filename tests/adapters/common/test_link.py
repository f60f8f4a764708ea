"""The link against a real WebSocket server that a test plays by hand."""

from __future__ import annotations

import logging
import socket
import ssl
import sys
import threading
import time
from http import HTTPStatus
from typing import TYPE_CHECKING, Any, Iterator, List, Set

import pytest
from oracle_adapter import Answer, Link, LinkError, Timing
from oracle_adapter.connection import attach_url
from oracle_adapter.protocol import Protocol

if TYPE_CHECKING:
    from concurrent.futures import Future

    from tests.adapters.common.conftest import News, Oracle, Peer

PATIENCE = 10.0
QUICK = Timing(backoff_first=0.01, backoff_last=0.05)


@pytest.fixture
def links() -> Iterator[List[Link]]:
    """Links to end with the test, whatever becomes of it."""
    made: List[Link] = []
    yield made
    for link in made:
        link.close(timeout=0)


@pytest.fixture
def link(oracle: Oracle, news: News, links: List[Link]) -> Link:
    links.append(Link(oracle.url, "uav1", timing=QUICK, **news.callbacks()))
    links[0].start()
    return links[0]


@pytest.fixture
def often_switched() -> Iterator[None]:
    """Threads take turns so often that they meet in every line."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(usual)


def answer_of(future: Future[Answer]) -> Answer:
    return future.result(PATIENCE)


def ask(link: Link, within: float = PATIENCE) -> Future[Answer]:
    return link.ask("/a", "request", None, {}, decide_within=within)


class TestAttaching:
    def test_the_handshake(self, oracle: Oracle, links: List[Link]) -> None:
        link = Link(oracle.url, "uav1", spec="s", session="x", streams=["/a"], token="secret")
        links.append(link)
        link.start()
        hello = oracle.accept().attach()
        request = oracle.requests.get_nowait()
        assert request.path == "/api/v1/attach"
        assert request.headers["Authorization"] == "Bearer secret"
        assert request.headers["Sec-WebSocket-Protocol"] == "oracle.v1"
        assert "Sec-WebSocket-Extensions" not in request.headers
        assert hello.pop("instance")
        assert hello == {"type": "attach", "monitor": "uav1", "session": "x", "spec": "s",
                         "streams": ["/a"], "clock": "wall"}  # fmt: skip
        attached = link.wait_attached(PATIENCE)
        assert (attached.session, attached.streams[0]["name"]) == ("x", "/a")

    def test_one_process_is_one_instance(self, oracle: Oracle, links: List[Link]) -> None:
        links += [Link(oracle.url, name) for name in ("uav1", "uav2")]
        for link in links:
            link.start()
        first, second = (oracle.accept().attach() for _ in links)
        assert first["instance"] == second["instance"]

    def test_no_token_no_header(self, oracle: Oracle, link: Link) -> None:
        oracle.accept()
        assert "Authorization" not in oracle.requests.get_nowait().headers

    def test_a_proxy_is_not_asked(
        self, oracle: Oracle, links: List[Link], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for name in ("http_proxy", "all_proxy", "ws_proxy"):
            monkeypatch.setenv(name, "http://127.0.0.1:9")
        monkeypatch.delenv("no_proxy", raising=False)
        links.append(Link(oracle.url, "uav1"))
        links[0].start()
        oracle.accept()

    def test_it_waits_for_the_server(self, oracle: Oracle, news: News, links: List[Link]) -> None:
        oracle.stop()
        link = Link(oracle.url, "uav1", timing=QUICK, **news.callbacks())
        links.append(link)
        link.start()
        link.send("/a", "topic", 1, {})
        assert news.error().code == "unreachable"
        with pytest.raises(LinkError, match=r"timeout: not attached within 0.01 s \(unreachable"):
            link.wait_attached(0.01)
        oracle.start()
        peer = oracle.accept()
        peer.attach()
        assert peer.events(1)[0]["seq"] == 1
        assert news.state() == "attached"
        assert news.errors.empty(), "attempts that fail alike are told once"

    @pytest.mark.parametrize("status", [401, 403, 421])
    def test_a_refusal_is_final(
        self, oracle: Oracle, news: News, links: List[Link], status: int
    ) -> None:
        oracle.refuse_with = HTTPStatus(status)
        link = Link(oracle.url, "uav1", timing=QUICK, **news.callbacks())
        links.append(link)
        link.start()
        with pytest.raises(LinkError, match=f"HTTP {status}") as raised:
            link.wait_attached(PATIENCE)
        assert raised.value.fatal
        assert news.state() == "ended"
        assert news.error() is raised.value
        assert oracle.requests.qsize() == 1

    def test_a_server_that_is_not_ready_is_tried_again(
        self, oracle: Oracle, links: List[Link]
    ) -> None:
        oracle.refuse_with = HTTPStatus.SERVICE_UNAVAILABLE
        links.append(Link(oracle.url, "uav1", timing=QUICK, on_error=lambda error: None))
        links[0].start()
        oracle.requests.get(timeout=PATIENCE)
        oracle.refuse_with = None
        oracle.accept().attach()
        links[0].wait_attached(PATIENCE)

    def test_a_server_that_never_answers_is_left(self, oracle: Oracle, links: List[Link]) -> None:
        timing = Timing(attach_timeout=0.05, ping_interval=0.02, backoff_first=0.01)
        links.append(Link(oracle.url, "uav1", timing=timing, on_error=lambda error: None))
        links[0].start()
        first = oracle.accept()
        oracle.accept().attach()
        first.wait_finished()

    def test_it_starts_once(self, link: Link) -> None:
        with pytest.raises(RuntimeError):
            link.start()

    @pytest.mark.parametrize(
        ("given", "used"),
        [
            ("ws://h:1", "ws://h:1/api/v1/attach"),
            ("http://h:1/", "ws://h:1/api/v1/attach"),
            ("https://h", "wss://h/api/v1/attach"),
            ("wss://h/robots/", "wss://h/robots/api/v1/attach"),
            ("ws://[::1]:8642/api/v1/attach", "ws://[::1]:8642/api/v1/attach"),
        ],
    )
    def test_addresses(self, given: str, used: str) -> None:
        assert attach_url(given) == used

    @pytest.mark.parametrize(
        "url", ["", "h:8642", "127.0.0.1:8642", "ftp://h", "ws://", "ws://h:x"]
    )
    def test_what_is_no_address_is_refused_at_once(self, url: str) -> None:
        with pytest.raises(ValueError, match=r"address|[Pp]ort"):
            Link(url, "uav1")

    def test_tls_needs_a_tls_address(self) -> None:
        with pytest.raises(ValueError, match="wss://"):
            Link("ws://127.0.0.1:8642", "uav1", tls=ssl.create_default_context())


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

    def test_it_never_waits(self, oracle: Oracle, news: News, links: List[Link]) -> None:
        link = Link(oracle.url, "uav1", capacity=100, **news.callbacks())
        links.append(link)
        link.start()
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        peer.freeze()
        started = time.monotonic()
        queued = [link.send("/a", "topic", n, "x" * 100_000) for n in range(120)]
        assert time.monotonic() - started < 1
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
    def test_a_decision_and_its_outcome(self, oracle: Oracle, link: Link) -> None:
        peer = oracle.accept()
        peer.attach()
        future = ask(link)
        assert peer.events(1)[0]["ask"] is True
        assert not future.cancel()
        peer.send("decision", seq=1, decision="deny", denied_by=["p"], verdicts={"p": "false"})
        answer = answer_of(future)
        assert (answer.decision, answer.denied_by, answer.seq) == ("deny", ("p",), 1)
        link.outcome(answer, False, "decision")
        assert peer.recv() == {"type": "outcome", "seq": 1, "passed": False, "why": "decision"}

    def test_silence_is_a_timeout_and_a_late_decision_nothing(
        self, oracle: Oracle, link: Link
    ) -> None:
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        started = time.monotonic()
        late = ask(link, within=0.1)
        answer = answer_of(late)
        assert 0.1 <= time.monotonic() - started < 1
        assert answer.why == "timeout"
        in_time = ask(link)
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
        link.outcome(answer, False, "unavailable")
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

    def test_before_the_start_is_a_mistake(self, oracle: Oracle) -> None:
        with pytest.raises(LinkError, match="not started"):
            ask(Link(oracle.url, "uav1"))


class TestReconnecting:
    def test_it_resumes(self, oracle: Oracle, news: News, link: Link) -> None:
        peer = oracle.accept()
        peer.attach(session="anonymous-1")
        for number in range(1, 6):
            link.send("/a", "topic", number, {})
        peer.events(5)
        peer.send("ack", upto=2)
        peer.drop()
        peer = oracle.accept()
        hello = peer.attach(upcoming=4)
        assert (hello["session"], hello["spec"]) == ("anonymous-1", "spec")
        assert [event["seq"] for event in peer.events(2)] == [4, 5]
        assert [news.state() for _ in range(3)] == ["attached", "disconnected", "attached"]
        assert link.stats().reconnects == 1

    @pytest.mark.parametrize("code", [1000, 1001, 1011, 1012])
    def test_after_any_close(self, oracle: Oracle, link: Link, code: int) -> None:
        peer = oracle.accept()
        peer.attach()
        peer.close(code)
        oracle.accept().attach()

    def test_after_an_error_that_passes(self, oracle: Oracle, news: News, link: Link) -> None:
        peer = oracle.accept()
        peer.attach()
        peer.send("error", code="shutting_down", message="back soon", fatal=True)
        peer.close(1012)
        assert news.error().code == "shutting_down"
        oracle.accept().attach()

    @pytest.mark.parametrize("text", ["{", '{"type":"ack"}'])
    def test_after_what_is_no_frame(
        self, oracle: Oracle, news: News, link: Link, text: str
    ) -> None:
        peer = oracle.accept()
        peer.attach()
        peer.send_text(text)
        oracle.accept().attach()
        assert news.state() == "attached"
        assert "bad_frame" in news.states.get(timeout=PATIENCE)[1]

    def test_many_breaks(self, oracle: Oracle, link: Link) -> None:
        futures: List[Future[Answer]] = []
        seen: List[int] = []
        answered: Set[int] = set()

        def robot() -> None:
            for number in range(1, 1001):
                if number % 50:
                    link.send("/a", "topic", number, {})
                else:
                    futures.append(link.ask("/a", "request", number, {}, decide_within=PATIENCE))
                    futures[-1].result()

        def serve(peer: Peer, silent: bool) -> None:
            """Read up to three frames, and break off before the first decision where silent."""
            for _ in range(3):
                frame = peer.recv()
                for event in frame.get("events", [frame]):
                    if event["seq"] == len(seen) + 1:
                        seen.append(event["stamp"])
                    if event["ask"] and silent:
                        return
                    if event["ask"]:
                        peer.send("decision", seq=event["seq"], decision="allow")
                        answered.add(event["seq"])
                if len(answered) == 20:
                    return
                peer.send("ack", upto=max(0, len(seen) - 5))

        thread = threading.Thread(target=robot)
        thread.start()
        breaks = 0
        while thread.is_alive():
            peer = oracle.accept()
            peer.attach(upcoming=len(seen) + 1, limits={"max_batch": 20})
            serve(peer, silent=breaks % 2 == 0)
            if len(answered) == 20:
                thread.join()
            peer.drop()
            breaks += 1
        assert seen == list(range(1, 1001))
        assert {answer_of(future).decision for future in futures} == {"allow"}
        stats = link.stats()
        assert (stats.lost, stats.reconnects) == (0, breaks - 1)
        assert stats.resent > 0

    @pytest.mark.parametrize("unread", [0, 50], ids=["idle", "with a full send buffer"])
    def test_a_dead_peer_is_found_within_three_seconds(
        self, oracle: Oracle, links: List[Link], unread: int
    ) -> None:
        link = Link(oracle.url, "uav1")
        links.append(link)
        link.start()
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        peer.freeze()
        started = time.monotonic()
        for number in range(unread):
            link.send("/a", "topic", number, "x" * 500_000)
        again = oracle.accept()
        assert time.monotonic() - started < 3.5  # with the first pause before connecting again
        again.attach()
        again.events(unread)

    def test_a_slow_line_with_signs_of_life_is_kept(
        self, oracle: Oracle, news: News, links: List[Link]
    ) -> None:
        timing = Timing(ping_interval=0.05, ping_timeout=0.1, backoff_first=0.01)
        link = Link(oracle.url, "uav1", timing=timing, **news.callbacks())
        links.append(link)
        link.start()
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        peer.freeze()  # pings are not answered, as if they stood behind much data
        started = time.monotonic()
        while time.monotonic() - started < 0.5:
            peer.send("violation", n=1)
            news.violations.get(timeout=PATIENCE)
        assert link.stats().reconnects == 0
        assert news.states.qsize() == 1

    def test_a_port_that_swallows_everything(self, news: News, links: List[Link]) -> None:
        with socket.socket() as hole:
            hole.bind(("127.0.0.1", 0))
            hole.listen()
            timing = Timing(open_timeout=0.05, backoff_first=0.01)
            url = f"ws://127.0.0.1:{hole.getsockname()[1]}"
            link = Link(url, "uav1", timing=timing, **news.callbacks())
            links.append(link)
            link.start()
            assert news.error().code == "unreachable"
            assert answer_of(ask(link, within=0.1)).why == "unavailable"
            link.close(timeout=0)


class TestEnding:
    def detach(self, peer: Peer) -> None:
        assert peer.recv() == {"type": "detach"}
        peer.send("detached")

    def test_close_delivers_and_detaches(self, oracle: Oracle, news: News, link: Link) -> None:
        peer = oracle.accept()
        peer.attach()
        link.send("/a", "topic", 1, {})
        done: List[bool] = []
        closing = threading.Thread(target=lambda: done.append(link.close(PATIENCE)))
        closing.start()
        peer.events(1)
        self.detach(peer)
        closing.join()
        assert done == [True]
        peer.wait_finished()
        assert [news.state() for _ in range(2)] == ["attached", "ended"]
        assert not link.send("/a", "topic", 2, {})
        assert answer_of(ask(link)).why == "unavailable"
        assert link.stats().lost == 1 + 1
        assert link.close()

    def test_as_a_context(self, oracle: Oracle) -> None:
        def serve() -> None:
            peer = oracle.accept()
            peer.attach()
            self.detach(peer)

        server = threading.Thread(target=serve)
        server.start()
        with Link(oracle.url, "uav1") as link:
            link.wait_attached(PATIENCE)
        server.join()

    def test_close_reconnects_to_deliver(self, oracle: Oracle, link: Link) -> None:
        peer = oracle.accept()
        peer.attach()
        link.send("/a", "topic", 1, {})
        peer.events(1)
        closing = threading.Thread(target=link.close)
        closing.start()
        assert peer.recv() == {"type": "detach"}
        peer.drop()
        peer = oracle.accept()
        peer.attach(upcoming=1)
        peer.events(1)
        self.detach(peer)
        closing.join()
        assert link.stats().lost == 0

    def test_close_does_not_wait_longer_than_told(
        self, oracle: Oracle, news: News, link: Link
    ) -> None:
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        future = ask(link)
        peer.events(1)
        peer.freeze()
        started = time.monotonic()
        assert not link.close(timeout=0.1)
        assert time.monotonic() - started < 1
        assert answer_of(future).why == "unavailable"

    def test_close_without_a_server(self, oracle: Oracle, links: List[Link]) -> None:
        oracle.stop()
        for values in ([], [1, 2]):
            link = Link(oracle.url, "uav1", on_error=lambda error: None)
            links.append(link)
            link.start()
            for value in values:
                link.send("/a", "topic", value, {})
            started = time.monotonic()
            assert not link.close(timeout=0.3 if values else PATIENCE)
            assert time.monotonic() - started < 2
            assert link.stats().lost == len(values)

    def test_close_before_the_start(self, oracle: Oracle) -> None:
        link = Link(oracle.url, "uav1")
        assert not link.close()
        with pytest.raises(LinkError, match="closed"):
            link.wait_attached()
        assert answer_of(ask(link)).why == "unavailable"

    def test_a_callback_can_not_close(self, oracle: Oracle, links: List[Link]) -> None:
        raised: List[BaseException] = []
        told = threading.Event()

        def on_state(state: str, detail: str) -> None:
            try:
                links[0].close()
            except RuntimeError as error:
                raised.append(error)
                told.set()

        links.append(Link(oracle.url, "uav1", on_state=on_state))
        links[0].start()
        oracle.accept().attach()
        assert told.wait(PATIENCE)
        assert "callback" in str(raised[0])

    @pytest.mark.parametrize("code", ["spec_mismatch", "monitor_taken", "unknown_spec"])
    def test_a_fatal_answer_to_attach(
        self, oracle: Oracle, news: News, link: Link, code: str
    ) -> None:
        future = ask(link)
        peer = oracle.accept()
        assert peer.recv()["type"] == "attach"
        peer.send("error", code=code, message="so it is", fatal=True)
        with pytest.raises(LinkError, match=f"{code}: so it is"):
            link.wait_attached(PATIENCE)
        answer = answer_of(future)
        assert (answer.why, answer.reason) == ("unavailable", f"{code}: so it is")
        assert news.state() == "ended"
        assert news.error().code == code
        peer.wait_finished()
        assert oracle.requests.qsize() == 1

    @pytest.mark.parametrize("code", ["replaced", "session_closed"])
    def test_a_fatal_error_later(self, oracle: Oracle, news: News, link: Link, code: str) -> None:
        peer = oracle.accept()
        peer.attach()
        future = ask(link)
        peer.events(1)
        peer.send("error", code=code, message="so it is", fatal=True)
        assert answer_of(future).why == "unavailable"
        assert [news.state() for _ in range(3)] == ["attached", "disconnected", "ended"]
        assert news.error().fatal
        assert not link.close()

    @pytest.mark.parametrize("turn", range(10))
    def test_a_fatal_error_is_read_though_writing_fails(
        self, oracle: Oracle, news: News, link: Link, turn: int
    ) -> None:
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        over = threading.Event()

        def robot() -> None:
            while not over.is_set():
                link.send("/a", "topic", 1, "x" * 1000)

        thread = threading.Thread(target=robot)
        thread.start()
        peer.recv()
        peer.send("error", code="replaced", message="by another", fatal=True)
        peer.close(1008)
        assert [news.state() for _ in range(3)] == ["attached", "disconnected", "ended"]
        over.set()
        thread.join()
        assert news.error().code == "replaced"
        assert oracle.requests.qsize() == 1

    def test_a_mistake_of_our_own_answers_all_the_same(
        self,
        oracle: Oracle,
        news: News,
        link: Link,
        monkeypatch: pytest.MonkeyPatch,
        caplog: pytest.LogCaptureFixture,
    ) -> None:
        def fail(*args: Any) -> None:
            raise ZeroDivisionError

        peer = oracle.accept()
        peer.attach()
        future = ask(link)
        peer.events(1)
        monkeypatch.setattr(Protocol, "receive", fail)
        peer.send("ack", upto=1)
        assert answer_of(future).why == "unavailable"
        assert news.error().code == "internal"
        assert "ZeroDivisionError" in caplog.text


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
