"""What is right about recorded events, and what was wrong of all that was said of them.

What is right is what the same events say when they are judged in the order of their stamps, those of one stamp in the
order of arrival: so a verdict is wrong where a property holds at an event and is said not to, or the other way round.
"""

from __future__ import annotations

import json
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.paper.kept import Data
from oracle_server.core.spec import Spec
from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay

Name = tuple[str, int, str]
"""A verdict: the monitor and number of its event, and its property."""
_HOLDS = {"true": True, "currently_true": True, "false": False, "currently_false": False}
_NEEDED = ("stream", "kind", "monitor", "seq", "stamp", "source", "call", "ask", "signals", "failed")


@dataclass(frozen=True)
class Said:
    """What was said of one property at one event, and when (ns); `holds` is None where nothing was known."""

    at: int
    holds: bool | None


@dataclass(frozen=True)
class Wrong:
    """A verdict that was wrong for so long (ns), or None: for good."""

    name: Name
    said: bool
    lasted: int | None


def judged(spec: Spec, lines: Sequence[Data]) -> dict[Name, bool | None]:
    """What each property says at each event, when events are judged in this order."""
    with tempfile.NamedTemporaryFile("w", suffix=".jsonl") as file:
        for place, line in enumerate(lines, 1):
            file.write(
                json.dumps({key: line[key] for key in _NEEDED} | {"arrived": lines[0]["arrived"] + place}) + "\n"
            )
        file.flush()
        steps = list(Replay(spec, open_recording(Path(file.name), spec), by="arrival"))
    return {
        (j.step.event.monitor, j.step.event.seq, v.property): _HOLDS.get(v.outcome.value)
        for j in steps
        for v in j.verdicts
    }


def in_order(lines: Iterable[Data]) -> list[Data]:
    """The events as they were published."""
    return sorted(lines, key=lambda line: (line["stamp"], line["arrived"], line["seq"]))


def sayings(records: Iterable[Data]) -> dict[Name, list[Said]]:
    """All that was said of each verdict, in the order in which it was said."""
    said: dict[Name, list[Said]] = {}
    numbered: defaultdict[str, dict[int, Name]] = defaultdict(dict)
    for record in records:
        saying = Said(record["judged"], _HOLDS.get(record["outcome"]))
        if record["kind"] == "revision":
            first, last = record["revises"]["from"], record["revises"]["to"]
            for n, name in numbered[record["property"]].items():
                if first <= n <= last:
                    said[name].append(saying)
        else:
            name = (record["monitor"], record["seq"], record["property"])
            numbered[record["property"]][record["n"]] = name
            said[name] = [saying]
    return said


def wrong_ones(said: Mapping[Name, Sequence[Said]], truth: Mapping[Name, bool | None]) -> list[Wrong]:
    """The verdicts that were wrong at any time."""
    found = []
    for name, sayings_of in said.items():
        wrong = [s.holds is not None and s.holds is not truth[name] for s in sayings_of]
        if not any(wrong):
            continue
        ends = [s.at for s in sayings_of[1:]]
        spans = [end - s.at for s, end, is_wrong in zip(sayings_of, ends, wrong, strict=False) if is_wrong]
        found.append(Wrong(name, not truth[name], None if wrong[-1] else sum(spans)))
    return found
