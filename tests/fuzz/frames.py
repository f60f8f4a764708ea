"""Frames that are mostly as a monitor sends them, and sometimes not: values, numbers, stamps, texts at their ends."""

from __future__ import annotations

import json
import random
from dataclasses import dataclass, field
from typing import Any

BASE = 1_732_147_200 * 10**9
"""A time in the past (ns), from which stamps count."""
MS = 10**6
Frame = dict[str, Any]
Key = tuple[str, str]
"""A stream's name and kind."""

FIELDS = ("v", "id", "again", "mode", "level", "percentage", "switch_on", "success", "name", "list", "other", "at")
TEXTS = (
    "on", "off", "", " ", "NaN", "\0", "\x7f\x1b[31m", "\u202eright to left", "e\u0301\u0327", "\U0001f916" * 3,
    "\uffff", "\ufeff", "'; DROP TABLE steps; --", "<script>", "{topic: /a}", "x" * 2000, "\u00df" * 300, "\u2028",
    "%s%n", "\u0663",
)  # fmt: skip
NUMBERS = (
    0, 1, -1, 2, 7, 7.0, 11, 200, -0.0, 0.1, 1e308, -1e308, 5e-324, 2**31, 2**53, 2**53 + 1, 2**63 - 1, 2**63,
    2**64 - 1, -(2**63), True, False, None,
)  # fmt: skip
UNFIT: tuple[Any, ...] = (2**64, -(2**63) - 1, 10**400)
"""Integers that no event may hold."""
LONE = "\ud800"
"""A text that JSON can write, and UTF-8 can't."""
STAMPS = (None, 0, 1, 10**9, BASE, 2**53, 2**62, 2**63 - 2, 2**63 - 1)
COUNTS = (0, 1, 2, 1000, 2**31, 2**32, 2**53 - 1)
SOURCES = ("", "", "", "/a_node", "/a_node", "/b_node", "\U0001f916", "s" * 255)
GOALS = ("a", "a", "b", "0" * 32, "", "g" * 255, "NaN", "\0", "\U0001f916", "'; DROP TABLE steps; --")
STATUSES = ("accepted", "rejected", "executing", "canceling", "succeeded", "canceled", "aborted", "unknown")
OF_ACTIONS = frozenset({"goal", "reply", "feedback", "cancel", "result", "status"})
BAD_FIELDS: dict[str, tuple[Any, ...]] = {
    "stream": (None, 1, "", "/nowhere", "x" * 256, "\0"),
    "kind": (None, "", "tick", "Topic", 1, "unavailable"),
    "stamp": (-1, 2**63, 2**64, 1.5, "1", True, [], 1e18),
    "data": (None, [], "", 1),
    "ask": (None, 0, 1, "yes"),
    "source": (None, 1, "s" * 256),
    "call": (-1, 2**53, 1.0, "1"),
    "lost": (-1, 2**53, 0.5, None, "1"),
    "goal_id": (0, [], "g" * 256, True),
    "status": ("", "done", 1, [], "Accepted"),
    "seq": (0, -1, 2**53, 1.0, "1", None, True, []),
    "type": ("Event", "clock", None, 1, "attach"),
}


@dataclass
class Sent:
    """One frame, and the events in it: what is known of each, by its number."""

    text: str | bytes
    events: list[Event] = field(default_factory=list)


@dataclass(frozen=True)
class Event:
    """An event as it was written: `sound` where nothing is wrong with it, so that it must be judged."""

    seq: int
    stream: str
    kind: str
    text: str
    sound: bool = True


class Writer:
    """Writes frames for some streams of one spec, from one source of chance."""

    def __init__(self, chance: random.Random, streams: list[Key]) -> None:
        """Write events of `streams`; the time of their stamps goes on with each."""
        self.chance, self.streams = chance, streams
        self.now = BASE

    def event(self, seq: int, claimed: list[Key]) -> Event:
        """An event that must be judged where its stream is one of those claimed."""
        chance = self.chance
        stream, kind = chance.choice(claimed if claimed and chance.random() < 0.98 else self.streams)
        return self._written(seq, stream, kind, self._plain(seq, stream, kind), sound=(stream, kind) in claimed)

    def unsound(self, seq: int) -> Event:
        """An event with something wrong."""
        chance = self.chance
        stream, kind = chance.choice(self.streams)
        frame = self._plain(seq, stream, kind)
        how = chance.random()
        if how < 0.6:
            name = chance.choice(sorted(BAD_FIELDS))
            frame[name] = chance.choice(BAD_FIELDS[name])
        elif how < 0.75:
            frame["data"]["v"] = chance.choice(UNFIT)
        elif how < 0.9:
            frame["data"]["other"] = nested(chance, chance.choice((64, 65, 100, 900)))
        else:
            del frame[chance.choice(("stream", "data", "seq", *(["goal_id"] if kind in OF_ACTIONS else [])))]
        return self._written(seq, stream, kind, frame, sound=False)

    def unreadable(self, seq: int) -> Event:
        """An event that makes its whole frame one that can't be read."""
        chance = self.chance
        stream, kind = chance.choice(self.streams)
        frame = self._plain(seq, stream, kind)
        how = chance.randrange(4)
        if how == 0:
            frame["data"]["name"] = LONE
        text = json.dumps(frame)
        if how == 1:
            text = text[: chance.randrange(len(text))]
        elif how == 2:
            text = text.replace('"data": {', '"data": {"deep": ' + "[" * 2000 + "]" * 2000 + ", ", 1)
        elif how == 3:
            place = chance.randrange(len(text))
            text = text[:place] + chance.choice((*TEXTS, "}", "]", ",", '"', "\\u")) + text[place:]
        return Event(seq, stream, kind, text, sound=False)

    def clock(self, claimed: list[Key]) -> Frame:
        """A clock of some streams, mostly of the present."""
        chance = self.chance
        wanted = claimed if chance.random() < 0.7 else chance.sample(self.streams, chance.randint(1, len(self.streams)))
        wild = chance.random() < 0.03
        stamps = [
            {"stream": stream, "kind": kind, "stamp": (chance.choice(STAMPS) or 0) if wild else self.now}
            for stream, kind in wanted
        ]
        return {"type": "clock", "stamps": stamps}

    def report(self, claimed: list[Key]) -> Frame:
        """What a monitor reports of its streams: wherefrom their times come, and that something is past it."""
        chance = self.chance
        return {
            "type": "report",
            "streams": [
                {"stream": s, "kind": k, "time_source": chance.choice(("field", "middleware", "arrival", None))}
                | {
                    "trouble": chance.choice(TEXTS)[:1000],
                    "bypass": chance.choice(("", "", chance.choice(TEXTS)[:1000])),
                }
                for s, k in claimed
            ],
        }

    def outcome(self, seq: int) -> Frame:
        """What became of an event that was asked about."""
        chance = self.chance
        why = chance.choice(("decision", "decision", "timeout", "unavailable"))
        return {"seq": seq, "passed": chance.random() < 0.5, "why": why}

    def noise(self) -> str | bytes:
        """What is no frame, or none at this point."""
        chance = self.chance
        return chance.choice(
            (
                "", "{}", "[]", "null", "\0", '{"type":"event"}', '{"type":"events","events":{}}', "9" * 5000,
                '{"type":"hello"}', '{"type":"attach"}', '{"type":"clock","stamps":[{"stream":"/a","stamp":-1}]}',
                '{"type":"outcome","seq":0,"passed":true,"why":"decision"}', '{"type":"events","events":[]}',
                '{"type":"events","events":[null,1,[],{}]}', "[" * 5000, '{"type":"outcomes","outcomes":[]}',
                json.dumps({"type": "report", "streams": [{"stream": "/nowhere"}]}),
            )
        )  # fmt: skip

    def _plain(self, seq: int, stream: str, kind: str) -> Frame:
        chance = self.chance
        self.now += chance.choice((0, 1, MS, MS, MS, 5 * MS, 20 * MS, 300 * MS))
        frame: Frame = {"type": "event", "seq": seq, "stream": stream, "kind": kind, "data": self._data()}
        stamp = self.now if chance.random() < 0.9 else chance.choice((*STAMPS, self.now - 50 * MS, self.now + 50 * MS))
        if stamp is not None or chance.random() < 0.5:
            frame["stamp"] = stamp
        if kind != "topic" or chance.random() < 0.1:
            frame["call"] = chance.choice((seq, 0, 2**53 - 1))
        if kind in OF_ACTIONS or chance.random() < 0.02:
            frame |= {"goal_id": chance.choice(GOALS), "status": chance.choice(STATUSES)}
        if chance.random() < 0.25:
            frame["ask"] = True
        if chance.random() < 0.3:
            frame["source"] = chance.choice(SOURCES)
        if chance.random() < 0.1:
            frame["lost"] = chance.choice(COUNTS)
        if chance.random() < 0.02:
            frame[chance.choice(("unknown", "\u202e", ""))] = self._value(2)
        return frame

    def _data(self) -> Frame:
        chance = self.chance
        data = {name: self._value(0) for name in chance.sample(FIELDS, chance.randint(0, 6))}
        if chance.random() < 0.6:
            data["v"] = chance.choice((0, 1, 2, 7, 11))
        if chance.random() < 0.4:
            data["at"] = self.now // chance.choice((1000, 10**6)) - chance.choice((0, BASE // 1000))
        if chance.random() < 0.02:
            data["other"] = nested(chance, chance.randint(1, 62))
        if chance.random() < 0.003:
            data["name"] = chance.choice(("x", "\u00df", "\U0001f916")) * 50_000
        if chance.random() < 0.003:
            data["list"] = [{"k": i} for i in range(3000)]
        return data

    def _value(self, depth: int) -> Any:
        chance = self.chance
        kind = chance.random()
        if kind < 0.55 or depth > 2:
            return chance.choice(NUMBERS)
        if kind < 0.85:
            return chance.choice(TEXTS)
        if kind < 0.93:
            return [self._value(depth + 1) for _ in range(chance.randint(0, 4))]
        return {chance.choice((*FIELDS, *TEXTS)): self._value(depth + 1) for _ in range(chance.randint(0, 3))}

    def _written(self, seq: int, stream: str, kind: str, frame: Frame, *, sound: bool) -> Event:
        compact = self.chance.random() < 0.7  # as most adapters write, and the quick reader wants it
        text = json.dumps(frame, separators=(",", ":")) if compact else json.dumps(frame, ensure_ascii=False)
        return Event(seq, stream, kind, text, sound)


def batch(events: list[Event]) -> Sent:
    """Some events in one frame."""
    return Sent('{"type":"events","events":[' + ",".join(event.text for event in events) + "]}", events)


def nested(chance: random.Random, depth: int) -> Any:
    """Lists and objects in each other, so many."""
    value: Any = 1
    for _ in range(depth):
        value = [value] if chance.random() < 0.5 else {"v": value}
    return value
