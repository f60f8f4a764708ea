"""A stand-in for the server that takes an adapter's events, and decides by what a test says."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import Empty

from tests.adapters.common.conftest import Oracle, Peer
from tests.processes import Data


class Judge:
    """Denies what `denies` says, and keeps the events and what was done with them."""

    def __init__(self, oracle: Oracle, streams: list[Data]) -> None:
        self.url = oracle.url
        self.denies: Callable[[Data], bool] = lambda _: False
        self.answers = True
        """Whether it decides; else it hangs."""
        self.seen: list[Data] = []
        self.handled: list[Data] = []
        self.reports: dict[str, str] = {}
        """The troubles, by stream and kind."""
        self._oracle, self._streams = oracle, streams
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def of(self, *kinds: str) -> list[Data]:
        """The events of some kinds."""
        return [event for event in list(self.seen) if event["kind"] in kinds]

    def stop(self) -> None:
        self._over.set()
        self._thread.join()

    def _work(self) -> None:
        peers: list[Peer] = []
        upcoming = 1
        while not self._over.is_set():
            try:
                peers.append(self._oracle._peers.get_nowait())
                upcoming = max([1, *(event["seq"] + 1 for event in self.seen)])
                peers[-1].attach(upcoming=upcoming, streams=self._streams, limits={"max_outcomes": 1000})
            except Empty:
                pass
            for peer in peers:
                self._read(peer)
            self._over.wait(0 if peers and not peers[-1].frames.empty() else 0.001)

    def _read(self, peer: Peer) -> None:
        try:
            frame = peer.frames.get_nowait()
        except Empty:
            return
        events = frame["events"] if frame["type"] == "events" else [frame] if frame["type"] == "event" else []
        for event in events:
            self.seen.append(event)
            if event["ask"] and self.answers:
                denied_by = ["rule"] if self.denies(event) else []
                peer.send("decision", seq=event["seq"], decision="deny" if denied_by else "allow", denied_by=denied_by)
        if events:
            peer.send("ack", upto=events[-1]["seq"])
        if frame["type"] in ("outcome", "outcomes"):
            self.handled += frame.get("outcomes") or [frame]
        for report in frame.get("streams", ()) if frame["type"] == "report" else ():
            self.reports[f"{report['stream']} {report['kind']}"] = report.get("trouble") or ""
        if frame["type"] == "detach":
            peer.send("detached")


@contextmanager
def judge(streams: list[Data]) -> Iterator[Judge]:
    """A judge until the end."""
    oracle = Oracle()
    oracle.start()
    made = Judge(oracle, streams)
    try:
        yield made
    finally:
        made.stop()
        oracle.end()
