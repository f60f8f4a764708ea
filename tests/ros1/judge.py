"""An oracle that a test makes up: it says what is observed, decides as it is told, and keeps what it hears."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Literal

from tests.adapters.common.conftest import Oracle
from tests.processes import Data, eventually

Decide = Callable[[Data], str | Literal[False] | None]
"""What denies an event, None where it passes, False where there is no decision."""


class Judge:
    """Hears one adapter after the other."""

    def __init__(self, oracle: Oracle, streams: list[Data], decide: Decide) -> None:
        self.url, self.decide = oracle.url, decide
        self._events: list[Data] = []
        self._open: list[Data] = []
        self._outcomes: dict[int, bool] = {}
        self._reports: dict[tuple[str, str], Data] = {}
        self._oracle, self._streams, self._peer = oracle, streams, None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def end(self) -> None:
        self._ended.set()
        self._thread.join()

    def heard(self, kind: str = "", count: int = 0) -> list[Data]:
        """The events of a kind, or all, once there are so many."""
        return eventually(lambda: self._of(kind), lambda found: len(found) >= count)

    def passed(self, event: Data) -> bool:
        """Whether an event that was asked about passed, once that is known."""
        return bool(eventually(lambda: self._outcomes.get(event["seq"]), lambda told: told is not None))

    def troubles(self) -> list[str]:
        """What is reported to be wrong."""
        return [report["trouble"] for report in self._reports.values() if report.get("trouble")]

    def allow(self, kind: str) -> None:
        """Decide on what was left open."""
        for event in [event for event in self._open if event["kind"] == kind]:
            self._open.remove(event)
            self._answer(event, None)

    def _of(self, kind: str) -> list[Data]:
        return [event for event in list(self._events) if not kind or event["kind"] == kind]

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                peer = self._oracle.peers.get(timeout=0.05)
            except queue.Empty:
                continue
            self._peer = peer
            peer.attach(streams=self._streams, limits={"max_frame": 1 << 20, "max_outcomes": 1000})
            while not self._ended.is_set() and not (peer.finished.is_set() and peer.frames.empty()):
                try:
                    self._take(peer.frames.get(timeout=0.05))
                except queue.Empty:
                    continue

    def _take(self, frame: Data) -> None:
        match frame["type"]:
            case "events":
                for event in frame["events"]:
                    self._take(event)
            case "event":
                self._events.append(frame)
                if frame["ask"]:
                    found = self.decide(frame)
                    if found is False:
                        self._open.append(frame)
                    else:
                        self._answer(frame, found)
                self._say("ack", upto=frame["seq"])
            case "outcome":
                self._outcomes[frame["seq"]] = frame["passed"]
            case "outcomes":
                self._outcomes.update({one["seq"]: one["passed"] for one in frame["outcomes"]})
            case "report":
                for report in frame["streams"]:
                    self._reports.setdefault((report["stream"], report["kind"]), {}).update(report)
            case "detach":
                self._say("detached")

    def _answer(self, event: Data, denied_by: str | None) -> None:
        decision = {"decision": "deny", "denied_by": [denied_by]} if denied_by else {"decision": "allow"}
        self._say("decision", seq=event["seq"], verdicts={}, **decision)

    def _say(self, type_: str, **fields: Any) -> None:
        assert self._peer is not None
        if not self._peer.finished.is_set():
            self._peer.send(type_, **fields)


@contextmanager
def judge(streams: list[Data], decide: Decide = lambda _: None) -> Iterator[Judge]:
    """An oracle of a test's own."""
    oracle = Oracle()
    oracle.start()
    made = Judge(oracle, streams, decide)
    try:
        yield made
    finally:
        made.end()
        oracle.end()
