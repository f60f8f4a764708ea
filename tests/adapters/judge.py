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
        self.waits: Callable[[Data], bool] = lambda _: False
        """Which decisions wait for `release`."""
        self.seen: list[Data] = []
        self.handled: list[Data] = []
        self.reports: dict[str, str] = {}
        """The troubles, by stream and kind."""
        self._oracle, self._streams = oracle, streams
        self.clocks: dict[tuple[str, str], int] = {}
        """How far each stream is, by its name and kind (ns)."""
        self._held: list[Data] = []
        self._over, self._released = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def of(self, *kinds: str) -> list[Data]:
        """The events of some kinds."""
        return [event for event in list(self.seen) if event["kind"] in kinds]

    def release(self) -> None:
        """Decide on all that waits, and let nothing wait any more."""
        self.waits = lambda _: False
        self._released.set()

    def stop(self) -> None:
        self._over.set()
        self._thread.join()

    def _work(self) -> None:
        peers: list[Peer] = []
        upcoming = 1
        while not self._over.is_set():
            try:
                peers.append(self._oracle.peers.get_nowait())
                upcoming = max([1, *(event["seq"] + 1 for event in self.seen)])
                peers[-1].attach(upcoming=upcoming, streams=self._streams, limits={"max_outcomes": 1000})
            except Empty:
                pass
            for peer in peers:
                self._read(peer)
            if self._released.is_set():
                self._released.clear()
                held, self._held = self._held, []
                for event in held:
                    self._decide(peers[-1], event)
            self._over.wait(0 if peers and not peers[-1].frames.empty() else 0.001)

    def _read(self, peer: Peer) -> None:
        try:
            frame = peer.frames.get_nowait()
        except Empty:
            return
        events = frame["events"] if frame["type"] == "events" else [frame] if frame["type"] == "event" else []
        for event in events:
            self.seen.append(event)
            if event["ask"] and self.waits(event):
                self._held.append(event)
            elif event["ask"] and self.answers:
                self._decide(peer, event)
        if events:
            peer.send("ack", upto=events[-1]["seq"])
        if frame["type"] in ("outcome", "outcomes"):
            self.handled += frame.get("outcomes") or [frame]
        for clock in frame["stamps"] if frame["type"] == "clock" else ():
            self.clocks[clock["stream"], clock["kind"]] = clock["stamp"]
        for report in frame.get("streams", ()) if frame["type"] == "report" else ():
            self.reports[f"{report['stream']} {report['kind']}"] = report.get("trouble") or ""
        if frame["type"] == "detach":
            peer.send("detached")

    def _decide(self, peer: Peer, event: Data) -> None:
        denied_by = ["rule"] if self.denies(event) else []
        peer.send("decision", seq=event["seq"], decision="deny" if denied_by else "allow", denied_by=denied_by)


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
