"""Many frames in one packet: some are taken as they come, some wait, and none overtakes another."""

from __future__ import annotations

import json
from itertools import count

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.whole.client import Frame, Monitor, attached, make_clock, make_event, make_events, seqs
from tests.whole.harness import Server

SESSIONS = count(1)
KINDS = st.sampled_from(["event"] * 6 + ["ask", "batch", "clock", "spaced", "nonsense"])


def written(frame: Frame, *, spaced: bool = False) -> str:
    return json.dumps(frame, separators=None if spaced else (",", ":"))


def texts(kinds: list[str], size: int) -> tuple[list[str], int]:
    """Frames of these kinds, and the number of their last event."""
    found, numbers, last = [], count(1), 0
    for kind in kinds:
        if kind == "clock":
            found.append(written(make_clock("/a", 0)))
        elif kind == "nonsense":
            found.append("{")
        elif kind in ("batch", "spaced"):
            events = [make_event(last := next(numbers), data={"v": 1}) for _ in range(size)]
            found.append(written(make_events(*events), spaced=kind == "spaced"))
        else:
            last = next(numbers)
            found.append(written(make_event(last, data={"v": 1}, ask=kind == "ask")))
    return found, last


def write_at_once(monitor: Monitor, frames: list[str]) -> None:
    protocol = monitor.socket.protocol
    for text in frames:
        protocol.send_text(text.encode())
    monitor.socket.transport.write(b"".join(protocol.data_to_send()))


@pytest.mark.parametrize("size", [1, 3, 200])
@settings(
    max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(kinds=st.lists(KINDS, min_size=1, max_size=150))
async def test_frames_in_one_packet_are_judged_in_their_order(server: Server, size: int, kinds: list[str]) -> None:
    session = f"packet-{next(SESSIONS)}"
    frames, last = texts(kinds, size)
    async with attached(server, session=session, spec="single") as monitor:
        write_at_once(monitor, frames)
        await monitor.acked(last)
    assert seqs(server, session) == list(range(1, last + 1))
