"""The link against a real WebSocket server that a test plays by hand: attaching."""

from __future__ import annotations

import ssl
from http import HTTPStatus
from typing import TYPE_CHECKING, List

import pytest
from oracle_adapter import Link, LinkError, Timing
from oracle_adapter.connection import Address, attach_url
from tests.adapters.common.links import PATIENCE, QUICK

if TYPE_CHECKING:
    from tests.adapters.common.conftest import News, Oracle


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

    def test_each_is_an_instance_of_its_own(self, oracle: Oracle, links: List[Link]) -> None:
        links += [Link(oracle.url, name) for name in ("uav1", "uav2")]
        for link in links:
            link.start()
        first, second = (oracle.accept().attach() for _ in links)
        assert first["instance"] != second["instance"]

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

    def test_attempts_that_are_refused_alike_are_told_once(
        self, oracle: Oracle, news: News, links: List[Link]
    ) -> None:
        links.append(Link(oracle.url, "uav1", timing=QUICK, **news.callbacks()))
        links[0].start()
        for message in ("its file is unsound", "its file is unsound", "there is no such type"):
            peer = oracle.accept()
            peer.recv()
            peer.send("error", code="bad_spec", message=message, fatal=True)
            peer.close(1008)
        oracle.accept().attach()
        assert news.state() == "attached"
        told = [error.message for error in list(news.errors.queue) if error.code == "bad_spec"]
        assert told == ["its file is unsound", "there is no such type"]

    def test_a_server_that_never_answers_is_left(self, oracle: Oracle, links: List[Link]) -> None:
        timing = Timing(attach_timeout=0.05, ping_interval=0.02, backoff_first=0.01)
        links.append(Link(oracle.url, "uav1", timing=timing, on_error=lambda error: None))
        links[0].start()
        oracle.accept().wait_finished()
        oracle.accept()

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
        ("url", "shown"),
        [
            ("ws://uav1:secret@h:8642/api/v1/attach", "ws://h:8642/api/v1/attach"),
            ("ws://uav1:12/secret@h:8642/api/v1/attach", "ws://h:8642/api/v1/attach"),
            ("unix:///run/a@b.sock", "unix:///run/a@b.sock"),
        ],
    )
    def test_what_may_be_a_password_is_not_shown(self, url: str, shown: str) -> None:
        assert Address(url).shown == shown

    @pytest.mark.parametrize(
        "url",
        ["", "h:8642", "127.0.0.1:8642", "ftp://h", "ws://", "ws://h:x", "http://robot..local:1"],
    )
    def test_what_is_no_address_is_refused_at_once(self, url: str) -> None:
        with pytest.raises(ValueError, match=r"address|[Pp]ort"):
            Link(url, "uav1")

    def test_a_password_in_the_address_is_shown_to_nobody(
        self, oracle: Oracle, news: News, links: List[Link]
    ) -> None:
        oracle.stop()
        url = oracle.url.replace("//", "//uav1:secret@")
        links.append(Link(url, "uav1", timing=QUICK, **news.callbacks()))
        links[0].start()
        told = str(news.error())
        assert oracle.url in told
        assert "secret" not in told

    @pytest.mark.parametrize(
        "url",
        [
            "ftp://uav1:secret@h",
            "uav1:secret@h",
            "unix://uav1:secret@h",
            "http://uav1:secret@robot..local:1",
            "http://uav1:secret/secret@h:1",
            "http://uav1:secret#@h",
            "http://uav1:secret[@h",
            "http://uav1:secret\u2100@h",
            "http://h,http://uav1:secret,secret@h",
            "http://uav1:secret@h",  # tls needs another one
        ],
    )
    def test_nor_is_that_of_an_address_that_is_none(self, url: str) -> None:
        with pytest.raises(ValueError, match=r"address|port") as refused:
            Link(url, "uav1", tls=ssl.create_default_context())
        assert "secret" not in str(refused.value)

    def test_tls_needs_a_tls_address(self) -> None:
        with pytest.raises(ValueError, match="wss://"):
            Link("ws://127.0.0.1:8642", "uav1", tls=ssl.create_default_context())
