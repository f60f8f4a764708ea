"""What is held for one monitor, and not seen at the events of others: properties about both say so while it goes on."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from oracle_server.core.hazards import apart
from oracle_server.history.memory import MemoryHistory
from oracle_server.process.clock import Clock
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.status import session_state
from oracle_server.sessions.summary import brief
from oracle_server.specfiles.library import Library
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, registry

SPEC = """
id: two
streams:
  - {topic: /scan, signals: {near: msg.near, limit: msg.limit}, hold: [near, limit]}
  - {topic: /cmd, signals: {speed: msg.v}}
  - {topic: /odom, signals: {x: msg.x}}
define:
  close: '{near}'
  going: '{topic: /cmd, speed > 0}'
derive:
  last_near: {last: near}
  margin: limit - speed
  half: limit / 2.0
  braked: {count: '{topic: /cmd, speed: 0} and {near}', over: 5s}
  mode: {start: a, otherwise: stay, states: {a: {close: b}, b: {going: a}}}
properties:
  - {id: p, FORMULA}
"""


@pytest.fixture(autouse=True)
async def within() -> AsyncIterator[None]:
    async with asyncio.timeout(PATIENCE):
        yield


def told(live: LiveSession) -> list[str]:
    (row,) = session_state(live, 0)["properties"]
    caveats: list[str] = row["caveats"]
    return caveats


@pytest.mark.parametrize(
    ("formula", "held"),
    [
        ("formula: '{topic: /cmd, speed > 1} -> not {near}'", "near"),
        ("pattern: 'while {near}: no /cmd {speed > 1}'", "near"),
        ("formula: '{topic: /cmd} -> not close'", "near"),
        ("formula: 'not {margin < 0}'", "limit"),
        ("formula: '{topic: /cmd} -> not {half < 1}'", "limit"),
        ("formula: 'not {braked > 2}'", "near"),
        ("formula: '{topic: /cmd, speed > 1} -> not {last_near}'", None),
        ("formula: '{topic: /cmd, speed > 1} -> not {mode: b}'", None),
        ("formula: '({topic: /scan} -> {near: false}) and ({topic: /cmd} -> {speed < 1})'", None),
        ("formula: 'not {near}'", None),  # which asks of no other stream
    ],
)
async def test_it_is_told_as_long_as_both_are_there(tmp_path: Path, formula: str, held: str | None) -> None:
    history = MemoryHistory()
    sessions = registry(history, tmp_path, SPEC.replace("FORMULA", formula))
    live, _ = await sessions.attach(attach("s", "two", monitor="lidar", streams=["/scan"]), Kept())
    assert told(live) == []
    _, base = await sessions.attach(attach("s", "two", monitor="base", streams=["/cmd", "/odom"]), Kept())
    says = (
        f"{held} of /scan is held for lidar alone, and not seen at /cmd of base: what is held is of each monitor by "
        f"itself; `{{last: {held}}}` under `derive` is of all"
    )
    assert told(live) == ([says] if held else [])
    assert brief(session_state(live, 0))["caveats"] == told(live), "the list of sessions has it, too"

    await sessions.flush()
    later = Registry(history, Library(None, tmp_path), Clock(), resume_within=PATIENCE)
    await later.restore_all()
    assert told(later.open["s"]) == told(live), "over a restart, too"

    live.detach(base)
    await sessions.attach(attach("s", "two", monitor="both"), Kept())
    assert told(live) == [], "whose events see what they hold themselves"


async def test_of_a_spec_that_takes_long_to_look_at_rather_too_much_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All sessions wait for it: of a spec as large as one may be it took a minute."""
    monkeypatch.setattr(apart, "_MOST", 0)
    decided = "formula: '({topic: /scan} -> {near: false}) and ({topic: /cmd} -> {speed < 1})'"
    sessions = registry(MemoryHistory(), tmp_path, SPEC.replace("FORMULA", decided))
    live, _ = await sessions.attach(attach("s", "two", monitor="lidar", streams=["/scan"]), Kept())
    await sessions.attach(attach("s", "two", monitor="base", streams=["/cmd", "/odom"]), Kept())
    (text,) = told(live)
    assert text.startswith("near of /scan is held for lidar alone, and not seen at /cmd of base")


async def test_of_many_signals_the_first_are_told(tmp_path: Path) -> None:
    names = [f"h{n}" for n in range(9)]
    spec = SPEC.replace("near: msg.near", ", ".join(f"{name}: msg.{name}" for name in ("near", *names)))
    spec = spec.replace("hold: [near", f"hold: [{', '.join(('near', *names))}")
    asked = " or ".join(f"{{{name}}}" for name in names)
    sessions = registry(MemoryHistory(), tmp_path, spec.replace("FORMULA", f"formula: '{{topic: /cmd}} -> {asked}'"))
    live, _ = await sessions.attach(attach("s", "two", monitor="lidar", streams=["/scan"]), Kept())
    await sessions.attach(attach("s", "two", monitor="base", streams=["/cmd", "/odom"]), Kept())
    assert [text.split()[0] for text in told(live)] == names[:3]


async def test_of_many_monitors_a_few_are_named(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, SPEC.replace("FORMULA", "formula: '{topic: /cmd} -> not {near}'"))
    for number in range(10, 15):
        live, _ = await sessions.attach(attach("s", "two", monitor=f"lidar{number}", streams=["/scan"]), Kept())
    for number in range(10, 14):
        await sessions.attach(attach("s", "two", monitor=f"base{number}", streams=["/cmd"]), Kept())
    (text,) = told(live)
    assert "held for lidar10, lidar11, lidar12 and 2 other monitors alone" in text
    assert "at /cmd of base10 and base11 and base12 and base13:" in text
