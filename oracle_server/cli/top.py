"""What goes on in a running server, drawn again and again: its sessions, and how much each does."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from rich.console import Console
from rich.live import Live

from oracle_server.cli.client import Client
from oracle_server.cli.tables import SESSIONS, cell, in_doubt, session_row, status_of, violations_of
from oracle_server.process.tables import print_table, table
from oracle_server.sessions.summary import idle

_DOUBT = "in doubt"
_HEAD = ("session", "status", "monitors", "steps/s", "held", "violations", "open", "wrong now", _DOUBT)
_EVERY = 2.0
"""Seconds between two looks."""


def watch_sessions(client: Client, origin: str | None = None) -> None:
    """Draw the sessions, or those that are forwarded from a robot, until Ctrl-C."""

    def rows() -> list[tuple[str, ...]]:
        states = client.get("sessions", origin=origin)["items"]
        return [(*session_row(state), in_doubt(state) or idle(state)) for state in states]

    _watch((*SESSIONS, _DOUBT), rows)


def show_top(client: Client) -> None:
    """Draw the open sessions with their rates and open episodes until Ctrl-C; once where this is no terminal."""
    _watch(_HEAD, Top(client).rows)


class Top:
    """The open sessions, those with open episodes first and then those in doubt, with what each does meanwhile."""

    def __init__(self, client: Client, clock: Callable[[], float] = time.monotonic) -> None:
        """Look at a server; the clock is in seconds."""
        self._client, self._clock = client, clock
        self._steps: dict[str, int] = {}
        self._at = 0.0

    def rows(self) -> list[tuple[str, ...]]:
        """Look, and compare with the last look."""
        states = [state for state in self._client.get("sessions")["items"] if state["status"] != "closed"]
        now = self._clock()
        wrong: dict[str, list[str]] = {}
        for episode in self._client.pages("episodes", open=True):
            wrong.setdefault(episode["session"], []).append(episode["property"])
        told = {state["id"]: state["counters"]["steps"] for state in states}
        steps = {name: count for name, count in told.items() if count is not None}
        passed = now - self._at
        rates = {name: (steps[name] - before) / passed for name, before in self._steps.items() if name in steps}
        self._steps, self._at = steps, now
        doubts = {state["id"]: in_doubt(state) for state in states}
        rows = [_row(s, rates.get(s["id"]), wrong.get(s["id"], []), doubts[s["id"]]) for s in states]

        def gravest(row: tuple[str, ...]) -> tuple[int, bool, float, str]:
            name = row[0]
            return -len(wrong.get(name, ())), not doubts[name], -rates.get(name, 0.0), name

        return sorted(rows, key=gravest)


def _row(state: dict[str, Any], rate: float | None, wrong: list[str], doubt: str) -> tuple[str, ...]:
    return (
        state["id"],
        status_of(state),
        str(sum(monitor["connected"] for monitor in state["monitors"])),
        "-" if rate is None else f"{rate:.0f}",
        cell(state["counters"]["held"]),
        violations_of(state),
        str(len(wrong)),
        ", ".join(Counter(wrong)),
        doubt or idle(state),
    )


def _watch(head: Sequence[str], rows: Callable[[], Sequence[Sequence[str]]]) -> None:
    if not sys.stdout.isatty():
        print_table(head, rows(), sys.stdout)
        return
    console = Console()
    try:
        with Live(table(head, rows(), console.width), console=console, screen=True, auto_refresh=False) as live:
            while True:
                time.sleep(_EVERY)
                live.update(table(head, rows(), console.width), refresh=True)
    except KeyboardInterrupt:
        return
