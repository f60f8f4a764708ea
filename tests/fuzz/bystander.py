"""Another session on the same server, whose every decision and record is known before."""

from __future__ import annotations

import asyncio
import json

from tests.chaos.by_hand import attached
from tests.chaos.served import PATIENCE, Served
from tests.fuzz.frames import BASE, MS, Frame

_EVERY = 10
"""Frames of the others after which it asks again."""


class Bystander:
    """Asks whether a lamp may be switched on, in the dark and in the light by turns, as the others go on."""

    def __init__(self, served: Served, session: str) -> None:
        self.session = session
        self.asked = 0
        self.wrong: list[str] = []
        self._served = served
        self._turn = asyncio.Event()
        self._frames = 0
        self._ending = False

    def frame(self) -> None:
        """Note that one of the others sends a frame."""
        self._frames += 1
        if self._frames % _EVERY == 0:
            self._turn.set()

    def end(self) -> None:
        """Ask as often as is due, and end."""
        self._ending = True
        self._turn.set()

    async def run(self) -> None:
        """Ask at each turn, until `end`."""
        streams = ["/light", "/switch"]
        async with attached(self._served, "lamp", self.session, "m1", streams) as socket:
            clock = {"stream": "/switch", "kind": "response", "stamp": 2**62}
            await socket.send(json.dumps({"type": "clock", "stamps": [clock]}))
            while not self._ending or self.asked * _EVERY < self._frames:
                for frame in self._turn_of(self.asked):
                    await socket.send(json.dumps(frame))
                async with asyncio.timeout(PATIENCE):
                    while (answer := json.loads(await socket.recv()))["type"] in ("ack", "violation", "credit"):
                        pass
                self.asked += 1
                wanted = {"type": "decision", "seq": 2 * self.asked, "decision": decision(self.asked - 1)}
                if {name: answer.get(name) for name in wanted} != wanted:
                    self.wrong.append(f"the bystander got {answer}, and not {wanted}")
                while self.asked * _EVERY > self._frames and not self._ending:
                    await self._turn.wait()
                    self._turn.clear()
            await socket.send('{"type":"detach"}')
            async with asyncio.timeout(PATIENCE):
                while json.loads(await socket.recv())["type"] != "detached":
                    pass

    async def check(self) -> None:
        """Compare its history with what it must be."""
        records = await self._served.records(self.session)
        said = [
            (r["n"], r["seq"], r["property"], r["outcome"], r["decision"], r["degraded"], r["late"]) for r in records
        ]
        wanted = []
        for turn in range(self.asked):
            holds = "currently_true" if dark(turn) else "currently_false"
            for place, (seq, outcome, decided) in enumerate(
                [(2 * turn + 1, "currently_true", None), (2 * turn + 2, holds, decision(turn))]
            ):
                for index, (name, said_of_it) in enumerate(
                    [("only_in_the_dark", outcome), ("battery_is_plausible", "currently_true")]
                ):
                    n = 4 * turn + 2 * place + index + 1
                    wanted.append((n, seq, name, said_of_it, decided, False, False))
        if said != wanted:
            first = next((pair for pair in zip(said, wanted, strict=False) if pair[0] != pair[1]), "the number of them")
            self.wrong.append(f"the bystander's records differ: {first}")

    def _turn_of(self, turn: int) -> list[Frame]:
        seq, stamp = 2 * turn + 1, BASE + 2 * turn * MS
        light = {
            "type": "event",
            "seq": seq,
            "stream": "/light",
            "stamp": stamp,
            "data": {"level": 3 if dark(turn) else 300},
        }
        clock = {"type": "clock", "stamps": [{"stream": "/light", "kind": "topic", "stamp": stamp + 2 * MS}]}
        request = {"stream": "/switch", "kind": "request", "data": {"switch_on": True}, "call": seq, "ask": True}
        return [light, clock, {"type": "event", "seq": seq + 1, "stamp": stamp + MS} | request]


def dark(turn: int) -> bool:
    """Whether it is dark at a turn."""
    return turn % 3 != 0


def decision(turn: int) -> str:
    """What must be decided at a turn."""
    return "allow" if dark(turn) else "deny"
