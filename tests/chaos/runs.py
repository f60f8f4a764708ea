"""Runs of a whole trace through a server to which something happens, and what must hold of their records."""

from __future__ import annotations

import asyncio
import random
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from examples.battery_uav.simulator import MS, arrivals, simulate
from tests.chaos.fleet import Fleet
from tests.chaos.link import Frame, Link
from tests.chaos.served import PATIENCE, Served
from tests.chaos.tunnel import Tunnel

SPECS = Path(__file__).parents[2] / "specs"
SESSION = "s1"
COUNTDOWNS = 8
LIMIT = 20 * PATIENCE
PASSING = frozenset({"arrived", "judged", "released", "waited", "decision", "passed"})
"""What a record says that may differ from run to run."""


class Layout(NamedTuple):
    """Which monitor observes what, and what is changed in the spec for that."""

    name: str
    monitors: dict[str, frozenset[str]]
    changes: tuple[tuple[str, str], ...] = ()
    waits: bool = True
    """Whether events wait for each other, however slow all is."""


SENSORS = frozenset({"/battery_percentage", "/input_accepted", "/battery_status"})
PANEL = frozenset({"/status_accepted", "/LED_panel", "/SetLED"})
ALONE = Layout("one monitor", {"uav1": SENSORS | PANEL})
PAIR = Layout(
    "two monitors",
    {"sensors": SENSORS, "panel": PANEL},
    # what comes in over two connections is only in order if events wait for each other, however slow all is
    (("max_delay: 200ms", "max_delay: 600s"), ("action: filter\n", "action: filter\n    decide_within: 700s\n")),
)
ROWS = (
    "InputAccepted\n    action: log\n    signals:\n      id: string(msg.id)",
    "InputAccepted\n    action: log\n    each: msg.inputs\n    signals:\n      id: string(item.id)",
)
"""Each message of /input_accepted lists the latest inputs, which are its rows."""
DERIVED = """derive:
  statuses: {count: '{topic: "/battery_status"}', over: 40}
  seen: {count: '{topic: "/battery_status"}', over: 2s, by: id}
properties:
  - {id: few_statuses, formula: '{topic: "/battery_status"} -> {statuses < 9, seen < 2}'}
"""
TRIO = Layout(
    "three monitors",
    {"sensors": SENSORS, "lights": PANEL - {"/SetLED"}, "service": frozenset({"/SetLED"})},
    (*PAIR.changes, ("properties:\n", DERIVED)),
)
LATE = Layout(
    "three monitors, none of which is waited for",
    TRIO.monitors,
    (
        ("max_delay: 200ms", "max_delay: 100ms"),
        ("late: judge", "late: revise\n  horizon: 600s"),
        *TRIO.changes[1:],
    ),
    waits=False,
)
each_layout = pytest.mark.parametrize("layout", [ALONE, PAIR], ids=lambda layout: layout.name)


def observed(countdowns: int = COUNTDOWNS) -> list[Frame]:
    """What is observed in so many countdowns, in order of publication, stamped so that all of it has just happened."""
    lines: list[dict[str, Any]] = arrivals(
        simulate(fault="request_without_change", countdowns=countdowns), MS, 0, in_order=True
    )
    shift = time.time_ns() - lines[-1]["stamp"]
    chance, inputs = random.Random(0), [line for line in lines if line["stream"] == "/input_accepted"]
    for i, line in reversed(list(enumerate(inputs))):
        line["data"] = {"inputs": [one["data"] for one in inputs[max(0, i - i % 3) : i + 1]]}
    return [
        {
            "type": "event",
            **{key: line[key] for key in ("stream", "kind", "source", "call", "data") if key in line},
            "stamp": line["stamp"] + shift,
            "ask": line["kind"] == "request" or chance.random() < 0.05,
        }
        for line in lines
    ]


async def uninterrupted(layout: Layout, trace: list[Frame], folder: Path, known: dict[str, list[Frame]]) -> list[Frame]:
    """The records of a run in which nothing happens."""
    if layout.name not in known:
        async with Served(specs(layout, folder), folder / "undisturbed") as served:
            links = await stream_through(served, layout, trace, random.Random(0), [], lambda _: None)
            known[layout.name] = await served.records(SESSION)
        assert_sound(known[layout.name], links)
        properties = {record["property"] for record in known[layout.name]}
        assert len(known[layout.name]) == len(properties) * sum(map(rows, trace))
        assert not any(record["late"] or record["skewed"] or record["degraded"] for record in known[layout.name])
        assert any(record["violation"] for record in known[layout.name])
    return known[layout.name]


async def stream_through(
    served: Served | Tunnel | Fleet,
    layout: Layout,
    trace: list[Frame],
    chance: random.Random,
    points: list[int],
    strike: Callable[[list[Link]], None],
    *,
    skips: bool = False,
    moves: bool = False,
) -> list[Link]:
    """Send the trace until all is settled; strike whenever what monitors were told comes to one of the points.

    `skips`: events may be skipped for want of space. `moves`: servers may take over from each other. Where a layout's
    monitors are not waited for, the last of them begins once a third of all was told: so what it has comes late.
    """
    left, seen, gate, behind = list(points), 0, asyncio.Event(), asyncio.Event()

    def moved(count: int) -> None:
        nonlocal seen
        seen += count
        if seen >= len(trace) // 3:
            behind.set()
        if left and seen >= left[0] and served.up.is_set():
            del left[0]
            strike(links)

    gates = dict.fromkeys(layout.monitors, gate) | ({} if layout.waits else {[*layout.monitors][-1]: behind})
    links = [
        Link(
            *(served, attach_frame(layout, monitor), own(trace, names), trace[-1]["stamp"] + 1, chance),
            *(gates[monitor], moved),
            waited_for=layout.waits,
            skips=skips,
            moves=moves,
        )
        for monitor, names in layout.monitors.items()
    ]
    async with asyncio.timeout(LIMIT), asyncio.TaskGroup() as tasks:
        runs = [tasks.create_task(link.run()) for link in links]
        for link in links:
            await link.attached.wait()
        gate.set()
        for link in links:
            await link.done.wait()
        for run in runs:
            run.cancel()
    assert not left
    return links


def assert_sound(records: list[Frame], links: list[Link]) -> None:
    """Every event is there, once a property, with the decision that its monitor was told; and `n` has no gaps."""
    assert [record["n"] for record in records] == list(range(1, len(records) + 1))
    properties = sorted({record["property"] for record in records})
    assert Counter(map(key, records)) == Counter(
        (link.attach["monitor"], event["seq"], row, name)
        for link in links
        for event in link.events
        for row in range(rows(event))
        for name in properties
    )
    for link in links:
        monitor = link.attach["monitor"]
        decided = {r["seq"]: r["decision"] for r in records if r["monitor"] == monitor and r["decision"] is not None}
        assert decided == {seq: frame["decision"] for seq, frame in link.decisions.items()}
        assert decided.keys() == {event["seq"] for event in link.events if event["ask"]}


def assert_same(records: list[Frame], expected: list[Frame]) -> None:
    """The records say what those of an uninterrupted run say, one by one."""
    for record, other in zip(records, expected, strict=True):
        changed = {k: (v, other[k]) for k, v in record.items() if k not in PASSING and v != other[k]}
        assert record.keys() - {"waited"} == other.keys() - {"waited"}, (record, other)
        assert not changed, f"n {record['n']}: {changed}"


def key(record: Frame) -> tuple[str, int, int, str]:
    """What a record is of: monitor, number, row, property."""
    return record["monitor"], record["seq"], record.get("row", 0), record["property"]


def rows(event: Frame) -> int:
    """How many steps an event makes."""
    return len(event["data"].get("inputs", "_"))


def told(trace: list[Frame]) -> int:
    """How much monitors are told of a trace: an ack for each event, and the decisions."""
    return len(trace) + sum(event["ask"] is True for event in trace)


def own(trace: list[Frame], names: frozenset[str]) -> list[Frame]:
    """One monitor's events of a trace, numbered."""
    observed = [event for event in trace if event["stream"] in names]
    return [event | {"seq": seq} for seq, event in enumerate(observed, start=1)]


def attach_frame(layout: Layout, monitor: str) -> Frame:
    streams = sorted(layout.monitors[monitor])
    return {
        "type": "attach",
        "monitor": monitor,
        "instance": f"process of {monitor}",
        "session": SESSION,
        "spec": "battery_uav",
        "streams": streams,
    }


def specs(layout: Layout, folder: Path) -> Path:
    """A folder with the layout's spec."""
    text = (SPECS / "battery_uav.yaml").read_text()
    for old, new in (ROWS, *layout.changes):
        assert old in text
        text = text.replace(old, new)
    target = folder / "specs"
    target.mkdir(exist_ok=True)
    (target / "battery_uav.yaml").write_text(text)
    return target


def void(_: object) -> None:
    """Nothing, whatever is given."""
