"""The link against a real WebSocket server: connections that are lost."""

from __future__ import annotations

import socket
import threading
import time
from typing import TYPE_CHECKING, List, Set

import pytest
from oracle_adapter import Answer, Link, Timing
from tests.adapters.common.links import PATIENCE, answer_of, ask

if TYPE_CHECKING:
    from concurrent.futures import Future

    from tests.adapters.common.conftest import News, Oracle, Peer


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

    @pytest.mark.parametrize(
        "text",
        [
            "{",
            '{"type":"ack"}',
            '{"type":"ack","upto":1e999}',
            pytest.param('{"type":' + "[" * 100_000, id="nested"),
        ],
    )
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

    @pytest.mark.parametrize("unread", [0, 25], ids=["idle", "with a full send buffer"])
    def test_a_dead_peer_is_found(self, oracle: Oracle, links: List[Link], unread: int) -> None:
        timing = Timing(ping_interval=0.05, ping_timeout=2.0, backoff_first=0.01)
        link = Link(oracle.url, "uav1", timing=timing)
        links.append(link)
        link.start()
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        peer.freeze()
        for number in range(unread):
            link.send("/a", "topic", number, "x" * 500_000)
        again = oracle.accept()
        again.attach()
        again.events(unread)

    def test_a_dead_peer_is_found_within_three_seconds_by_default(self) -> None:
        usual = Timing()
        assert usual.ping_interval + usual.ping_timeout <= 3.0

    def test_a_slow_line_with_signs_of_life_is_kept(
        self, oracle: Oracle, news: News, links: List[Link]
    ) -> None:
        timing = Timing(ping_interval=0.05, ping_timeout=2.0, backoff_first=0.01)
        link = Link(oracle.url, "uav1", timing=timing, **news.callbacks())
        links.append(link)
        link.start()
        peer = oracle.accept()
        peer.attach()
        link.wait_attached(PATIENCE)
        peer.freeze()  # pings are not answered, as if they stood behind much data
        started = time.monotonic()
        while time.monotonic() - started < 1.5 * timing.ping_timeout:
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
