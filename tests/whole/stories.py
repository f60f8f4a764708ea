"""Long stories for the spec `pair`: what a monitor sends, drawn at random from a seed, the same each time."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

from tests.whole.client import Frame, Monitor, make_clock, make_event

STREAMS = (("/a", "topic"), ("/b", "topic"), ("/go", "request"), ("/go", "response"))


@dataclass
class Chunk:
    """Some events after which nothing is held, as clocks have moved on behind the newest of them."""

    events: list[Frame]
    until: float
    refused: set[int] = field(default_factory=set)

    @property
    def last(self) -> int:
        return int(self.events[-1]["seq"])

    @property
    def clocks(self) -> list[Frame]:
        return [make_clock(name, self.until, kind) for name, kind in STREAMS]


def tell(seed: int, chunks: int, length: int = 12, *, mischief: bool = True) -> list[Chunk]:
    """A story. With mischief, events come late, unordered, malformed or never."""
    dice, seq, now, story = random.Random(seed), 0, 0.0, []
    for _ in range(chunks):
        settled, chunk = now, Chunk([], 0)
        for place in range(length):
            seq += 1
            now += dice.choice((1, 1, 5, 20))
            what = "plain" if place in (0, length - 1) or not mischief else dice.choice(("plain",) * 6 + ODD)
            if what == "gap":
                seq += dice.randint(1, 3)
            at = max(0.0, settled - 10) if what == "late" else now
            event = _event(dice, seq, at)
            if what == "free":
                event |= {"stream": "/free", "kind": "topic", "data": {"v": dice.choice((0, 1, 2, 5, 20))}}
                event.pop("ask", None)
            if what == "malformed":
                event["data"] = "nothing"
                chunk.refused.add(seq)
            chunk.events.append(event)
        chunk.until = now
        story.append(chunk)
    return story


ODD = ("gap", "late", "free", "free", "free", "malformed")


def _event(dice: random.Random, seq: int, at: float) -> Frame:
    stream, kind = dice.choice(STREAMS)
    data = {"id": dice.randint(1, 4), "v": dice.choice((0, 1, 7, 7.0, 11, 200)), "mode": dice.choice(("on", "off"))}
    if dice.random() < 0.2:
        del data[dice.choice(sorted(data))]
    event = make_event(seq, stream, at, data, kind=kind)
    return event | {"ask": True, "call": seq} if kind == "request" else event


async def play(monitor: Monitor, chunk: Chunk) -> dict[int, Frame]:
    """Send a chunk, wait until all of it is committed, and report what was done; the decisions by number."""
    asked = {e["seq"] for e in chunk.events if e.get("ask") and e["seq"] not in chunk.refused}
    decisions: dict[int, Frame] = {}
    await monitor.send(*chunk.events, *chunk.clocks)
    while monitor.upto < chunk.last or decisions.keys() != asked:
        frame = await monitor.recv()
        if frame["type"] == "decision":
            decisions[frame["seq"]] = frame
            passed = frame["decision"] == "allow"
            await monitor.send({"type": "outcome", "seq": frame["seq"], "passed": passed, "why": "decision"})
        elif frame["type"] == "error":
            assert frame["seq"] in chunk.refused
    return decisions
