"""The link against a real WebSocket server: closing, and fatal errors."""

from __future__ import annotations

import subprocess
import sys
import threading
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, List

import pytest
from oracle_adapter import Link, LinkError, Timing
from oracle_adapter.command import close
from oracle_adapter.protocol import Protocol
from tests.adapters.common.links import PATIENCE, QUICK, answer_of, ask

if TYPE_CHECKING:
    from tests.adapters.common.conftest import News, Oracle, Peer


def closed(link: Link, timeout: float) -> bool:
    """Whether the server has confirmed the end; `close` must return, though nobody answers."""
    done: List[bool] = []
    closing = threading.Thread(target=lambda: done.append(link.close(timeout)), daemon=True)
    closing.start()
    closing.join(PATIENCE)
    assert done, "it waits for ever"
    return done[0]


STUCK = """
import socket, threading
from oracle_adapter import Link

asked = threading.Event()

def look_up(*_, **__):
    asked.set()
    threading.Event().wait()

socket.getaddrinfo = look_up
link = Link("http://robot.invalid:8642", "uav1")
link.start()
asked.wait()
link.close(0.05)
"""


def test_a_process_ends_though_no_nameserver_answers() -> None:
    subprocess.run([sys.executable, "-c", STUCK], timeout=PATIENCE, check=True)


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
        assert news.errors.empty()
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

    def test_close_does_not_wait_longer_than_told(self, oracle: Oracle, links: List[Link]) -> None:
        link = Link(oracle.url, "uav1", timing=Timing(ping_interval=100 * PATIENCE))
        links.append(link)
        link.start()
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        future = ask(link, within=100 * PATIENCE)
        peer.events(1)
        peer.freeze()  # nothing but the time that close is told ends it
        assert not closed(link, timeout=0.1)
        assert answer_of(future).why == "unavailable"

    def test_close_without_a_server(self, oracle: Oracle, links: List[Link]) -> None:
        oracle.stop()
        for values in ([], [1, 2]):
            link = Link(oracle.url, "uav1", on_error=lambda error: None)
            links.append(link)
            link.start()
            for value in values:
                link.send("/a", "topic", value, {})
            assert not closed(link, timeout=0.3 if values else 100 * PATIENCE)
            assert link.stats().lost == len(values)

    def test_what_the_oracle_has_not_confirmed_at_the_end_is_told(
        self, oracle: Oracle, links: List[Link], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        link = Link(oracle.url, "uav1", on_error=lambda error: None)
        told: List[str] = []
        links.append(link)
        link.start()
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        oracle.stop()
        link.send("/a", "topic", 1, {})
        link.send("/a", "topic", 2, {})
        monkeypatch.setattr(link, "close", partial(link.close, 0.1))  # nobody comes back to confirm
        close(link, told.append)
        assert told == ["the oracle has not confirmed the last 2 events: they may be lost"]

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

    @pytest.mark.parametrize("code", ["spec_mismatch", "unknown_spec", "read_only"])
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

    def test_a_name_is_waited_for_that_another_process_has(
        self, oracle: Oracle, news: News, link: Link
    ) -> None:
        future = ask(link)
        for _ in range(3):
            peer = oracle.accept()
            assert peer.recv()["type"] == "attach"
            peer.send("error", code="monitor_taken", message="another one", fatal=True)
            peer.wait_finished()
        peer = oracle.accept()
        peer.attach()
        peer.events(1)
        peer.send("decision", seq=1, decision="allow", denied_by=[], verdicts={})
        assert answer_of(future).decision == "allow"
        assert str(news.error()) == "monitor_taken: another one"
        assert [news.state()] == ["attached"]
        assert news.errors.empty()

    def test_a_name_is_waited_for_no_longer_than_its_time(self, oracle: Oracle, news: News) -> None:
        timing = replace(QUICK, name_timeout=0.0)
        with Link(oracle.url, "uav1", timing=timing, **news.callbacks()) as link:
            peer = oracle.accept()
            assert peer.recv()["type"] == "attach"
            peer.send("error", code="monitor_taken", message="another one", fatal=True)
            with pytest.raises(LinkError, match="monitor_taken: another one"):
                link.wait_attached(PATIENCE)
            assert news.error().fatal
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
        codes = [news.error().code]
        if codes == ["lost"]:  # the queue was full by then
            codes = [news.error().code]
        assert codes == ["replaced"]
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
