"""What a long command shows: on a terminal only, and only once it has taken a while."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

from oracle_server.process.progress import progress

SHOWING = """
import sys, threading
from oracle_server.process.progress import progress
with progress("reading", "events", after={after}) as show:
    show(50, 200, 1000)
    threading.Event().wait({wait})
"""


def shown(after: float, wait: float) -> bytes:
    """What is written to a terminal."""
    ours, theirs = pty.openpty()
    code = SHOWING.format(after=after, wait=wait)
    subprocess.run([sys.executable, "-c", code], stderr=theirs, stdout=subprocess.DEVNULL, check=True)
    os.close(theirs)
    found = b""
    while True:
        try:
            chunk = os.read(ours, 4096)
        except OSError:
            break
        if not chunk:
            break
        found += chunk
    os.close(ours)
    return found


def test_a_terminal_is_told_how_far_and_how_fast() -> None:
    told = shown(0, 0)
    assert b"reading" in told
    assert b"25%" in told
    assert b"events/s" in told
    assert b"left" in told


def test_what_is_done_at_once_shows_nothing() -> None:
    assert shown(60, 0) == b""


def test_nothing_is_shown_but_to_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with progress("reading", "events", after=0) as show:
        show(1, 2, 3)
    assert capsys.readouterr() == ("", "")
