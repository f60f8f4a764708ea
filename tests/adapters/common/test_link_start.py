"""A link that can't start says so, and nothing waits for it."""

from __future__ import annotations

import asyncio
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, Coroutine, Iterator, List

import pytest
from oracle_adapter import Board, Link, LinkError, keeper, passing
from oracle_adapter.clocks import Clocks
from oracle_adapter.passing import Passing
from tests.adapters.common.conftest import Oracle
from tests.adapters.common.links import PATIENCE, answer_of, ask
from tests.adapters.common.test_passing import STREAM, Screen


def outcome_of(work: Any) -> Any:
    """What a call gave or raised; it fails where the call does not end."""
    found: List[Any] = []

    def run() -> None:
        try:
            found.append(work())
        except Exception as error:  # noqa: BLE001 - that is the question
            found.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    assert found, "it waits without end"
    return found[0]


@pytest.fixture
def link() -> Link:
    return Link("ws://127.0.0.1:9", "uav1")


def test_a_thread_that_dies_before_it_is_ready(link: Link, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> asyncio.AbstractEventLoop:
        raise OSError(24, "Too many open files")

    monkeypatch.setattr("asyncio.events.new_event_loop", fail)
    error = outcome_of(link.start)
    assert isinstance(error, LinkError)
    assert "Too many open files" in str(error)
    assert answer_of(ask(link)).why == "unavailable"
    assert outcome_of(link.wait_attached) is error
    assert not link.close()


def test_a_thread_that_can_not_be_made(link: Link, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patch:
        patch.setattr("threading.Thread.start", fail)
        with pytest.raises(LinkError, match="can't start new thread"):
            link.start()
    assert not link.close()


def test_a_thread_that_never_gets_ready(link: Link, monkeypatch: pytest.MonkeyPatch) -> None:
    freed = threading.Event()

    def hang(work: Coroutine[Any, Any, None]) -> None:
        work.close()
        freed.wait(PATIENCE)

    monkeypatch.setattr(keeper, "READY_WITHIN", 0.05)
    monkeypatch.setattr("asyncio.run", hang)
    error = outcome_of(link.start)
    freed.set()
    assert isinstance(error, LinkError)
    assert error.fatal
    assert not link.close()


def test_a_link_that_was_not_started_is_not_waited_for(link: Link) -> None:
    error = outcome_of(link.wait_attached)
    assert isinstance(error, LinkError)
    assert "not started" in str(error)


@pytest.fixture
def locked_key(tmp_path: Path) -> Path:
    """A client's certificate, and its key behind a password, in one file."""
    openssl = shutil.which("openssl")
    if openssl is None:
        pytest.skip("there is no openssl to make a key with")
    key, certificate = tmp_path / "key.pem", tmp_path / "cert.pem"
    words = ["req", "-x509", "-newkey", "rsa:2048", "-passout", "pass:secret", "-subj", "/CN=uav1"]
    files = ["-keyout", str(key), "-out", str(certificate)]
    subprocess.run([openssl, *words, *files], check=True, capture_output=True)
    both = tmp_path / "both.pem"
    both.write_bytes(certificate.read_bytes() + key.read_bytes())
    return both


def test_a_key_behind_a_password_is_an_error_and_no_question(locked_key: Path) -> None:
    program = "from oracle_adapter.tls import context_from; import sys\n"
    program += "context_from({'ORACLE_CLIENT_CERT': sys.argv[1]})"
    command = [sys.executable, "-c", program, str(locked_key)]
    # Its input stays open, and it has no terminal: a question would wait for an answer.
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    )
    assert process.stdin is not None
    assert process.stderr is not None
    try:
        assert process.wait(PATIENCE) == 1
        assert b"a key without a password" in process.stderr.read()
    finally:
        process.kill()
        process.stdin.close()
        process.stderr.close()


@pytest.fixture
def held(oracle: Oracle, links: List[Link]) -> Iterator[Link]:
    """An attached link whose thread is in a callback that does not return."""
    inside, freed = threading.Event(), threading.Event()

    def hold(record: Any) -> None:
        inside.set()
        freed.wait(PATIENCE)

    links.append(Link(oracle.url, "uav1", on_violation=hold))
    links[0].start()
    peer = oracle.accept()
    peer.attach()
    links[0].wait_attached(PATIENCE)
    peer.send("violation", n=1)
    assert inside.wait(PATIENCE)
    yield links[0]
    freed.set()


def test_who_waits_for_an_answer_is_released_where_the_links_thread_hangs(
    held: Link, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(passing, "GRACE", 0.05)
    stream = {**STREAM, "decide_within": 1, "on_unavailable": "pass"}
    waiting = Passing(held, Board("uav1", Screen()), stream, Clocks(lambda: 1))
    passed, reason = outcome_of(lambda: waiting.ask_and_wait(None, {}, 1, lambda: True))
    assert not passed
    assert "no answer" in reason
