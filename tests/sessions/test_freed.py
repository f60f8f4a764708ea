"""What a closed session held is free at once: the garbage collector no longer looks at what has lived for long."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator
from pathlib import Path

import pytest

from oracle_server.history.memory import MemoryHistory
from tests.sessions.making import Kept, attach, event, registry

HEAD = """
id: {id}
ordering: {{{ordering}}}
streams:
  - topic: /go
    signals: {{speed: msg.speed}}
properties:
"""
SPECS = {
    "back": ("by: arrival", ["- {id: slow, formula: 'not {speed > 3}'}"]),
    "publication": ("max_delay: 1s", ["- {id: slow, formula: 'exists[x]. once{speed: *x} and {speed: 4}'}"]),
    "both": ("by: both", ["- {id: slow, formula: 'once[:5s]{speed: 1}', time: seconds}"]),
    "ahead": ("by: arrival", ["- {id: met, formula: '{speed: 1} -> eventually[:1s] {speed: 2}', time: seconds}"]),
    "revise": (
        "late: revise, horizon: 60s",
        [
            "- {id: met, formula: 'historically[:1s] not {speed > 3}', time: seconds}",
            "- {id: seen, formula: 'once{speed: 1}'}",
        ],
    ),
    "stl": ("by: arrival", ["- {id: slow, engine: rtamt, formula: 'historically(speed < 3)'}"]),
    "far": ("by: arrival", ["- {id: slow, engine: external, url: 'ws://127.0.0.1:1/'}"]),
}


def text(spec_id: str) -> str:
    ordering, properties = SPECS[spec_id]
    return HEAD.format(id=spec_id, ordering=ordering) + "".join(f"  {line}\n" for line in properties)


@pytest.fixture
def uncollected() -> Iterator[None]:
    gc.disable()
    yield
    gc.enable()


async def run(folder: Path, spec: str) -> list[weakref.ref[object]]:
    """Open a session, let it judge, violations and late events included, and close it."""
    sessions, outbox = registry(MemoryHistory(), folder, text(spec)), Kept()
    live, monitor = await sessions.attach(attach("s", spec), outbox)
    for seq, speed in enumerate((1, 5, 4, 2, 4), 1):
        live.ingest(monitor, event(seq, speed=speed, ask=True))
    await outbox.expect("ack")
    live.ledger.save()
    live.detach(monitor)
    await outbox.expect("detached")
    assert await sessions.closed_within(live, 60)
    return [weakref.ref(part) for part in (live, live.ledger, live.core, *live.core.judges.values())]


@pytest.mark.usefixtures("uncollected")
@pytest.mark.parametrize("spec", SPECS)
async def test_a_closed_session_is_free_without_a_collection(tmp_path: Path, spec: str) -> None:
    closed = await run(tmp_path, spec)
    assert [part() for part in closed if part() is not None] == []
