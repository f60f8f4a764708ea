"""What goes on is drawn again and again on a terminal, and once elsewhere."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
from typing import Any, cast

import pytest

from oracle_server.cli.client import Client
from oracle_server.cli.top import Top
from tests.processes import PATIENCE
from tests.whole.harness import COMMAND, Server, run


def state(name: str, steps: int | None, held: int | None = 0, status: str = "open", *doubts: str) -> dict[str, Any]:
    return {
        "id": name,
        "spec": "s",
        "status": status,
        "monitors": [{"connected": True, "attached": False}, {"connected": False, "attached": False}],
        "counters": {"steps": steps, "held": held},
        "properties": [{"violations": 2}, {"violations": 1}],
        "doubts": doubts,
    }


class Served:
    """Answers what it is told to, one look after the other."""

    def __init__(self, *looks: tuple[list[dict[str, Any]], list[dict[str, Any]]]) -> None:
        self._looks = iter(looks)

    def get(self, path: str) -> dict[str, Any]:
        assert path == "sessions"
        sessions, self._episodes = next(self._looks)
        return {"items": sessions}

    def pages(self, path: str, **query: Any) -> list[dict[str, Any]]:
        assert (path, query) == ("episodes", {"open": True})
        return self._episodes


def test_rates_are_those_since_the_last_look_and_what_is_wrong_comes_first() -> None:
    wrong = [{"session": "b", "property": "p"}, {"session": "b", "property": "p"}, {"session": "b", "property": "q"}]
    unknown = state("unknown", None, None, "unrestored") | {"monitors": [], "properties": []}
    served = Served(
        ([state("a", 100), state("b", 50), state("gone", 5), unknown], []),
        ([state("a", 300), state("b", 51, 7), state("new", 1), unknown, state("old", 9, status="closed")], wrong),
    )
    times = iter([10.0, 14.0])
    top = Top(cast("Client", served), lambda: next(times))
    assert {row[3] for row in top.rows()} == {"-"}
    assert top.rows() == [
        ("b", "open", "1", "0", "7", "3", "3", "p, q", ""),
        ("a", "open", "1", "50", "0", "3", "0", "", ""),
        ("new", "open", "1", "-", "0", "3", "0", "", ""),
        ("unknown", "unrestored", "0", "-", "-", "-", "0", "", ""),
    ]


def test_what_is_in_doubt_is_told_and_comes_before_what_is_fine() -> None:
    troubled = state("troubled", 1) | {"trouble": "incomplete: it was cancelled"}
    lossy = state("lossy", 2, 0, "open", "5 events were lost", "p was unknown at 1 step")
    degraded = state("degraded", 3)
    degraded["properties"][0] |= {"id": "p", "caveats": ["/rogue publishes /a past the monitor"]}
    deaf = state("deaf", 4)
    deaf["monitors"][0] = {"connected": True, "attached": True, "streams": [{"stream": "/a", "trouble": "silent"}]}
    served = Served(([state("a_fine_one", 9), troubled, lossy, degraded, deaf], []))
    assert [(row[0], row[-1]) for row in Top(cast("Client", served), lambda: 1.0).rows()] == [
        ("deaf", "/a: silent"),
        ("degraded", "p is degraded: /rogue publishes /a past the monitor"),
        ("lossy", "5 events were lost (and 1 more)"),
        ("troubled", "incomplete: it was cancelled"),
        ("a_fine_one", ""),
    ]


@pytest.mark.parametrize("words", [("top",), ("sessions", "--watch")])
def test_elsewhere_than_on_a_terminal_it_is_printed_once(server: Server, words: tuple[str, ...]) -> None:
    printed = run(*words, "--url", server.url)
    assert (printed.returncode, printed.stderr) == (0, "")
    assert printed.stdout.startswith("session")


def said(terminal: int) -> bytes:
    """What comes next on a terminal; nothing where that takes too long."""
    ready, _, _ = select.select([terminal], [], [], PATIENCE)
    return os.read(terminal, 4096) if ready else b""


@pytest.mark.parametrize("words", [("top",), ("sessions", "--watch")])
def test_on_a_terminal_it_goes_on_until_ctrl_c(server: Server, words: tuple[str, ...]) -> None:
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [COMMAND, *words, "--url", server.url], stdin=theirs, stdout=theirs, stderr=theirs
    ) as drawing:
        os.close(theirs)
        drawn = b""
        while drawn.count(b"monitors") < 2:  # drawn again
            more = said(ours)
            assert more, drawn
            drawn += more
        drawing.send_signal(signal.SIGINT)
        rest = b""
        try:
            while data := said(ours):
                rest += data
        except OSError:  # its end on Linux
            pass
        try:
            assert drawing.wait(PATIENCE) == 0
        finally:
            drawing.kill()
    os.close(ours)
    assert b"Traceback" not in drawn + rest
