"""One monitor of a session: its numbering, its streams, and where frames for it are sent."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import Protocol

from oracle_server.core.bypass import Bypass
from oracle_server.core.events import StreamKey, TimeBase
from oracle_server.core.kinds import NOUNS
from oracle_server.core.ordering.numbering import Numbering
from oracle_server.core.spec import Spec
from oracle_server.core.verdicts import Decision, DecisionFrame, Judged, decision_frame
from oracle_server.history.records import MonitorRecord
from oracle_server.wire.errors import WireError
from oracle_server.wire.frames import Outgoing
from oracle_server.wire.incoming import EPISODES, REVISIONS, Attach, StreamReport


class Outbox(Protocol):
    """Sends frames to a monitor; never blocks."""

    def send(self, frame: Outgoing) -> None:
        """Queue a frame."""
        ...

    def drop(self, reason: WireError) -> None:
        """Send an error and close."""
        ...

    async def sent(self) -> None:
        """Wait until the last frame was sent, or the connection is lost."""
        ...

    async def reached(self) -> bool:
        """Whether the monitor still answers what is sent; that takes some seconds where it does not."""
        ...

    def finish(self, frame: Outgoing) -> None:
        """Send a last frame and close."""
        ...


@dataclass(slots=True)
class Monitor:
    """One monitor of a session, attached now or before."""

    name: str
    instance: str
    numbering: Numbering
    first: int = 0
    """The number that its process was told to go on at; lower ones are another's. 0 where no other was there."""
    outbox: Outbox | None = None
    streams: tuple[StreamKey, ...] = ()
    attached: bool = False
    clock: TimeBase = "wall"
    detaching: bool = False
    verdicts: bool = False
    """Whether it requested `verdicts` frames."""
    revisions: bool = False
    """Whether it requested `revision` frames."""
    episodes: bool = False
    """Whether it requested `episode` frames in place of `violation` ones."""
    lost: int = 0
    """Events that never arrived or could not be read since the last event; the next one carries this count."""
    unsettled: int = 0
    """Events and handlings that are received and not committed yet."""
    gaps: dict[int, int] = field(default_factory=dict)
    """How many numbers are missing before each event that is not written yet, by the event's number."""
    decisions: dict[int, DecisionFrame] = field(default_factory=dict)
    """Decisions on events that are not committed yet, by number."""
    handlings: dict[int, tuple[bool, str]] = field(default_factory=dict)
    """What the adapter did with events that are not written yet, by number: whether they passed, and why."""
    reports: dict[StreamKey, StreamReport] = field(default_factory=dict)
    """The monitor's last report on each of its streams."""
    bypasses: dict[StreamKey, Bypass] = field(default_factory=dict)
    """The streams that it reports to be bypassed."""
    expiry: asyncio.TimerHandle | None = None
    left: int | None = None
    """When it was detached (ns), None where it is not."""

    def report(self, report: StreamReport, now: int) -> bool:
        """Take a report on one of its streams at a time (ns); whether it changes what is known to be bypassed."""
        key = StreamKey(report.stream, report.kind)
        self.reports[key] = report
        before = self.bypasses.get(key)
        if report.bypass == (before.text if before else ""):
            return False
        if report.bypass:
            self.bypasses[key] = Bypass(report.bypass, before.since if before else now)
        else:
            del self.bypasses[key]
        return True

    def attach(self, wanted: Attach, outbox: Outbox, streams: tuple[StreamKey, ...]) -> None:
        """Take a connection for it, of the same process or of another one, with the streams that it claims.

        What was reported of a stream stands until it reports otherwise, and ends where it does not claim the stream.
        """
        if self.expiry:
            self.expiry.cancel()
            self.expiry = None
        if self.instance == wanted.instance:
            self.numbering.resume()
        else:
            self.numbering.restart()
            self.first = self.numbering.next
        self.reports = {key: report for key, report in self.reports.items() if key in streams}
        self.bypasses = {key: bypass for key, bypass in self.bypasses.items() if key in streams}
        self.instance, self.outbox, self.streams, self.detaching = wanted.instance, outbox, streams, False
        self.clock, self.verdicts = wanted.clock, wanted.verdicts
        self.revisions, self.episodes = REVISIONS in wanted.features, EPISODES in wanted.features

    def decide(self, judged: Judged, decision: Decision, *, send: bool) -> None:
        """Keep the decision on an event, for when that is sent again, and send it."""
        seq = judged.step.event.seq
        frame = self.decisions[seq] = decision_frame(seq, decision, {v.property: v.outcome for v in judged.verdicts})
        if self.outbox and send:
            self.outbox.send(frame)

    def record(self) -> MonitorRecord:
        """A copy of what the history keeps of it."""
        return MonitorRecord(
            self.name, self.instance, self.streams, self.attached, self.clock, dict(self.bypasses), self.left
        )

    def acknowledge(self) -> None:
        """Send an ack of all numbers up to which everything is committed."""
        if self.outbox:
            self.outbox.send({"type": "ack", "upto": self.numbering.upto})

    def confirm_detach(self) -> None:
        """Send `detached` where the monitor is detaching and all that it sent is committed."""
        if self.detaching and self.unsettled == 0 and self.outbox:
            self.outbox.finish({"type": "detached"})


def taken(name: str) -> WireError:
    """What a process is told that attaches by the name of one that is connected."""
    message = f"another process is attached as '{name}': end that one, or give this one another name"
    return WireError("monitor_taken", message, fatal=True)


def claimed(spec: Spec, wanted: Attach) -> tuple[StreamKey, ...]:
    """The keys of the streams that a monitor wants, all where it names none.

    Raises a fatal `WireError` for an unknown name, and for streams of a kind that the monitor does not know.
    """
    found = _named(spec, wanted.streams)
    for stream in (spec.by_key[key] for key in found):
        feature = stream.traits.feature
        if feature and feature not in wanted.features:
            message = (
                f"{stream.name} is {NOUNS[stream.traits.group]}, and the adapter '{wanted.monitor}' does not say that "
                f"it knows {feature} (`features` of `attach`): use a newer one, or let it name other streams alone"
            )
            raise WireError("needs_feature", message, fatal=True)
    return found


def _named(spec: Spec, names: list[str] | None) -> tuple[StreamKey, ...]:
    if names is None:
        return tuple(spec.by_key)
    unknown = sorted(set(names) - spec.names)
    if unknown:
        raise WireError("bad_attach", f"'{unknown[0]}' is no stream of {spec.id}", fatal=True)
    return tuple(key for key in spec.by_key if key.name in names)


def check_time(session: str, wanted: Attach, runs: TimeBase) -> None:
    """Raise a fatal `WireError` where a monitor's time, wall or simulated, is not that of its session."""
    if runs != wanted.clock:
        kinds = {"wall": "wall time", "sim": "simulated time"}
        message = (
            f"session '{session}' runs in {kinds[runs]}, and '{wanted.monitor}' in {kinds[wanted.clock]}: "
            f'attach it with `"clock": "{runs}"` (on ROS `use_sim_time`), or to another session'
        )
        raise WireError("clock_mismatch", message, fatal=True)
