"""What a session keeps of each of its monitors, and how it speaks to them."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import Protocol

from oracle_server.core.events import StreamKey
from oracle_server.core.numbering import Numbering
from oracle_server.core.simulated import TimeBase
from oracle_server.core.spec import Spec
from oracle_server.core.verdicts import DecisionFrame
from oracle_server.wire.errors import WireError
from oracle_server.wire.frames import Outgoing
from oracle_server.wire.incoming import Attach, StreamReport


class Outbox(Protocol):
    """Where frames to a monitor go; never blocks."""

    def send(self, frame: Outgoing) -> None:
        """Queue a frame."""
        ...

    def drop(self, reason: WireError) -> None:
        """Send an error and close."""
        ...

    async def sent(self) -> None:
        """Wait until the last frame was sent, or can't be any more."""
        ...

    def finish(self, frame: Outgoing) -> None:
        """Send a last frame and close."""
        ...


@dataclass(slots=True)
class Monitor:
    """One monitor of a session, attached or lately so."""

    name: str
    instance: str
    numbering: Numbering
    outbox: Outbox | None = None
    streams: tuple[StreamKey, ...] = ()
    attached: bool = False
    clock: TimeBase = "wall"
    detaching: bool = False
    verdicts: bool = False
    """Whether it wants to know how the properties stand."""
    lost: int = 0
    """Events that never came or could not be read, to be told with the next one that does."""
    unsettled: int = 0
    """Events taken and not committed yet."""
    gaps: dict[int, int] = field(default_factory=dict)
    """Events that are not on their way to the history yet, by number: how many numbers before each never came."""
    answers: dict[int, DecisionFrame] = field(default_factory=dict)
    """Decisions on events that are not committed yet, by number."""
    handlings: dict[int, tuple[bool, str]] = field(default_factory=dict)
    """What the adapter did about events that are not on their way to the history yet, by number."""
    reports: dict[StreamKey, StreamReport] = field(default_factory=dict)
    """What it says of its streams."""
    expiry: asyncio.TimerHandle | None = None

    def acknowledge(self) -> None:
        """Send up to which number all is committed."""
        if self.outbox:
            self.outbox.send({"type": "ack", "upto": self.numbering.upto})

    def let_go(self) -> None:
        """Confirm that it may leave, where it wants to, once all that it sent is committed."""
        if self.detaching and self.unsettled == 0 and self.outbox:
            self.outbox.finish({"type": "detached"})


def claimed(spec: Spec, names: list[str] | None) -> tuple[StreamKey, ...]:
    """The streams of these names, None for all. Raises a fatal `WireError` where there is no such stream."""
    if names is None:
        return tuple(spec.by_key)
    unknown = sorted(set(names) - spec.names)
    if unknown:
        raise WireError("bad_attach", f"'{unknown[0]}' is no stream of {spec.id}", fatal=True)
    return tuple(key for key in spec.by_key if key.name in names)


def check_time(session: str, wanted: Attach, runs: TimeBase) -> None:
    """Raise a fatal `WireError` where a monitor lives in another time than its session."""
    if runs != wanted.clock:
        kinds = {"wall": "wall time", "sim": "simulated time"}
        message = (
            f"session '{session}' runs in {kinds[runs]}, and '{wanted.monitor}' in {kinds[wanted.clock]}: "
            f'attach it with `"clock": "{runs}"` (on ROS `use_sim_time`), or to another session'
        )
        raise WireError("clock_mismatch", message, fatal=True)
