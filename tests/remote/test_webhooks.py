"""Alarms over HTTP: signed, in order, tried again, never waited for, and counted where they are dropped."""

from __future__ import annotations

import contextlib
import itertools
import socket
import ssl
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import trustme

from oracle_server.remote.receivers import Receiver
from oracle_server.remote.webhooks import MOST, Webhooks
from tests.processes import PATIENCE
from tests.remote.receiving import SECRET, Receiving, receiving

_TOLD = ("alarms do not arrive now", "alarms are dropped", "alarms arrive again")


@pytest.fixture
def receiver() -> Iterator[Receiving]:
    with receiving() as kept:
        yield kept


@contextmanager
def hooks(url: str, *what: Any, backoff: tuple[float, ...] = (0, 0)) -> Iterator[Webhooks]:
    made = Webhooks([Receiver(url, frozenset(what or ("violation",)), SECRET.encode())], backoff)
    try:
        yield made
    finally:
        made.close()


def until(good: Any) -> None:
    deadline = time.monotonic() + PATIENCE
    while not good():
        assert time.monotonic() < deadline
        time.sleep(0.001)


def test_an_alarm_is_signed_and_sent_once_to_who_wants_it(receiver: Receiving) -> None:
    with hooks(receiver.url, "violation", "final") as webhooks:
        assert (webhooks.wants("final"), webhooks.wants("degraded")) == (True, False)
        webhooks.send({"alarm": "degraded", "text": "not wanted"})
        webhooks.send({"alarm": "violation", "text": "ä"})
        webhooks.send({"alarm": "final"})
        headers, alarm = receiver.take()
        assert (alarm["alarm"], alarm["text"], headers["content-type"]) == ("violation", "ä", "application/json")
        assert receiver.take()[1]["alarm"] == "final"
        until(lambda: webhooks.sent == 2)
        assert (webhooks.dropped, webhooks.waiting, receiver.came.qsize()) == (0, 0, 0)


@pytest.mark.parametrize("status", [500, 503, 429, 408])
def test_an_alarm_that_is_not_taken_is_tried_again_as_it_was_at_another_time(
    receiver: Receiving, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A receiver refuses a try that is some minutes old, as a replay: what waited for so long would be lost."""
    receiver.answers = [status, status]
    times = itertools.count(1_000.5, 600)
    clock = SimpleNamespace(time=lambda: next(times), monotonic=time.monotonic)
    monkeypatch.setattr("oracle_server.remote.webhooks.time", clock)
    with hooks(receiver.url) as webhooks:
        webhooks.send({"alarm": "violation"})
        webhooks.send({"alarm": "violation", "second": True})
        first, again, last = (receiver.take() for _ in range(3))
        assert first[1] == again[1] == last[1]
        assert first[0]["webhook-id"] == again[0]["webhook-id"] == last[0]["webhook-id"]
        assert [each[0]["webhook-timestamp"] for each in (first, again, last)] == ["1000", "1600", "2200"]
        assert receiver.take()[1]["second"], "one after the other"
        until(lambda: webhooks.sent == 2)


@pytest.mark.parametrize("status", [302, 307, 400, 401, 404])
def test_an_alarm_that_is_refused_or_sent_elsewhere_is_dropped(receiver: Receiving, status: int) -> None:
    receiver.answers = [status]
    with hooks(receiver.url) as webhooks:
        webhooks.send({"alarm": "violation"})
        webhooks.send({"alarm": "violation", "second": True})
        receiver.take()
        assert receiver.take()[1]["second"], "no redirect was followed, nothing tried again"
        until(lambda: webhooks.sent == 1)
        assert webhooks.dropped == 1


def test_who_is_away_for_long_loses_alarms_and_is_tried_with_the_next(receiver: Receiving) -> None:
    receiver.answers = [500, 500, 500]
    with hooks(receiver.url) as webhooks:
        webhooks.send({"alarm": "violation"})
        until(lambda: webhooks.dropped == 1)
        webhooks.send({"alarm": "violation", "second": True})
        until(lambda: webhooks.sent == 1)
    with hooks("http://127.0.0.1:9/nobody") as webhooks:
        webhooks.send({"alarm": "violation"})
        until(lambda: webhooks.dropped == 1)


def test_the_log_has_no_more_of_an_address_than_its_host(
    receiver: Receiving, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is behind it lets anybody write to a chat."""
    receiver.answers = [400]
    with hooks(f"{receiver.url}/T000/s3cret?key=s3cret") as webhooks:
        webhooks.send({"alarm": "violation"})
        until(lambda: webhooks.dropped == 1)
    said = capsys.readouterr().out
    assert "alarms are dropped" in said
    assert "127.0.0.1" in said
    assert "s3cret" not in said


def test_it_is_told_at_once_where_alarms_do_not_arrive_and_once_they_do_again(
    receiver: Receiving, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing was said for the four minutes until the first was dropped."""
    receiver.answers = [500, 500, 400, 500, 204, 500]
    with hooks(receiver.url) as webhooks:
        for _ in range(3):
            webhooks.send({"alarm": "violation"})
        until(lambda: webhooks.sent == 2)
    lines = [line for line in capsys.readouterr().out.splitlines() if "alarms" in line]
    told = [next(text for text in _TOLD if text in line) for line in lines]
    assert told == [_TOLD[0], _TOLD[1], _TOLD[2], _TOLD[0], _TOLD[2]]
    assert "it answered 500" in lines[0]


def test_what_a_slow_receiver_leaves_has_an_end(receiver: Receiving) -> None:
    receiver.held.clear()
    with hooks(receiver.url) as webhooks:
        for n in range(MOST + 5):
            webhooks.send({"alarm": "violation", "count": n})
        assert (webhooks.waiting, webhooks.dropped) == (MOST, 5), "the first are kept: they say when it began"
        receiver.held.set()
        assert [receiver.take()[1]["count"] for _ in range(3)] == [0, 1, 2]


def test_a_server_that_stops_waits_for_nobody(receiver: Receiving) -> None:
    receiver.answers = [500] * 3
    with hooks(receiver.url, backoff=(3600.0,)) as webhooks:
        webhooks.send({"alarm": "violation"})
        receiver.take()
    assert not any(courier._thread.is_alive() for courier in webhooks._couriers)


def test_a_receiver_shows_a_certificate_of_an_authority_that_the_system_trusts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of a company: those of browsers alone were trusted, and its receivers got nothing."""
    authority, file = trustme.CA(), tmp_path / "authority.pem"
    authority.cert_pem.write_to_path(file)
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert("127.0.0.1").configure_cert(tls)
    with receiving(tls) as receiver:
        with hooks(receiver.url, backoff=()) as webhooks:
            webhooks.send({"alarm": "violation"})
            until(lambda: webhooks.dropped == 1)
        monkeypatch.setenv("SSL_CERT_FILE", str(file))
        with hooks(receiver.url, backoff=()) as webhooks:
            webhooks.send({"alarm": "violation", "text": "trusted"})
            assert receiver.take()[1]["text"] == "trusted"
            until(lambda: webhooks.sent == 1)


def test_an_answer_that_comes_byte_by_byte_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each byte came in time, and no other alarm was ever sent."""
    monkeypatch.setattr("oracle_server.remote.webhooks._WITHIN", 0.2)

    def answer_twice(listener: socket.socket) -> None:
        for _ in range(2):
            connection, _ = listener.accept()
            with connection, contextlib.suppress(OSError):
                connection.recv(65_536)
                connection.sendall(b"HTTP/1.1 200 OK\r\nX: ")
                while True:
                    connection.sendall(b"a")
                    time.sleep(0.01)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        serving = threading.Thread(target=answer_twice, args=(listener,), daemon=True)
        serving.start()
        with hooks(f"http://127.0.0.1:{listener.getsockname()[1]}/", backoff=(0,)) as webhooks:
            webhooks.send({"alarm": "violation"})
            until(lambda: webhooks.dropped == 1)
        serving.join(PATIENCE)
        assert not serving.is_alive(), "it was tried again, and cut off each time"
