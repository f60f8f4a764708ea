"""What Foxglove and other tools draw of a recorded session."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import msgspec
import pytest
from mcap.writer import Writer

from tests.foxglove.reading import Read, drawn, read
from tests.whole.client import BASE, attached, make_clock, make_event
from tests.whole.harness import Server, failed, run
from tests.whole.test_recorded import STREAMS, comparable, live, spec_of

MS = 10**6


def recorded(server: Server, session: str, folder: Path) -> Path:
    out = folder / "session.mcap"
    ended = run("record", session, "-o", out, "--url", server.url)
    assert ended.returncode == 0, ended.stderr
    assert list(folder.iterdir()) == [out]
    return out


def of(messages: list[Read], topic: str) -> list[Read]:
    return [message for message in messages if message.topic == topic]


@pytest.mark.parametrize("spec", STREAMS)
async def test_a_property_is_drawn_wherever_it_changes(server: Server, session: str, tmp_path: Path, spec: str) -> None:
    await live(server, session, spec, random.Random(spec))
    messages, _ = read(recorded(server, session, tmp_path))
    told = server.records(session)
    assert spec == "both" or any(r["violation"] for r in told)
    for name, order in {(r["property"], r["order"]) for r in told}:
        topic = f"/oracle/{name}" + ("/arrival" if order == "arrival" else "")
        found = [
            (m.data["n"], m.data["outcome"], m.data["violation"], m.data["degraded"], m.time, m.published)
            for m in of(messages, topic)
        ]
        assert found == drawn(r for r in told if (r["property"], r["order"]) == (name, order))
    values = {"true": 1, "currently_true": 1, "unknown": 0, "currently_false": -1, "false": -1}
    verdicts = [m for m in messages if m.schema == "oracle_server.Verdict"]
    assert all(m.data["value"] == values[m.data["outcome"]] for m in verdicts)
    whys = {r["n"]: r["explanation"]["text"] for r in told if r["violation"]}
    assert {m.data["n"]: m.data["explanation"] for m in verdicts if "explanation" in m.data} == whys
    assert len({m.topic for m in verdicts}) == len({(r["property"], r["order"]) for r in told})


async def test_the_signals_of_a_stream_and_what_was_decided_have_types(
    server: Server, session: str, tmp_path: Path
) -> None:
    """Whenever a signal is there for the first time, and whatever it is then."""
    async with attached(server, session=session, spec="lamp") as monitor:
        await monitor.send(make_clock("/switch", 10**9, "response"), make_clock("/battery", 10**9))
        await monitor.send(
            make_event(1, "/battery", 1, {"percentage": None}), make_event(2, "/battery", 2, {"percentage": 3})
        )
        await monitor.send(make_event(3, "/light", 3, {"level": 300}), make_clock("/light", 10**9))
        request = {"stream": "/switch", "kind": "request", "data": {"switch_on": True}, "call": 1}
        assert (await monitor.ask(4, at=4, **request))["decision"] == "deny"
        await monitor.send({"type": "outcome", "seq": 4, "passed": False, "why": "decision"})
        await monitor.acked(4)
        await monitor.detach()
    messages, shapes = read(recorded(server, session, tmp_path))
    signals = {
        topic: {path.removeprefix(".signals."): kind for path, kind in shape.items() if path.startswith(".signals.")}
        for topic, shape in shapes.items()
    }
    assert signals["/battery"] == {"percentage": "number"}
    assert signals["/light"] == {"dark": "boolean"}
    assert signals["/switch/request"] == {"switch_on": "boolean"}
    (asked,) = of(messages, "/switch/request")
    assert (asked.data["ask"], asked.data["decision"], asked.data["passed"]) == (True, "deny", False)
    assert asked.data["denied_by"] == ["only_in_the_dark"]
    assert asked.published == BASE + 4 * MS
    assert asked.time == asked.data["arrived"]
    assert "decision" not in of(messages, "/light")[0].data


async def test_robustness_is_a_number_wherever_it_changes(server: Server, session: str, tmp_path: Path) -> None:
    async with attached(server, session=session, spec="robust") as monitor:
        for i, v in enumerate([1.5, 1.5, 2, 4, 0.1]):
            await monitor.send(make_event(i + 1, at=8 * i, data={"v": v}))
        await monitor.send(make_clock("/a", 1_000), make_clock("/b", 1_000))
        await monitor.acked(5)
    told = server.records(session, property="small")
    messages, shapes = read(recorded(server, session, tmp_path))
    assert shapes["/oracle/small"][".robustness"] == "number"
    wanted = [
        (r["n"], r["robustness"]) for i, r in enumerate(told) if not i or r["robustness"] != told[i - 1]["robustness"]
    ]
    found = [(m.data["n"], m.data["robustness"]) for m in of(messages, "/oracle/small")]
    assert found[: len(wanted)] == wanted
    assert len(wanted) > 2


async def test_violations_that_follow_each_other_closely_are_one_episode_of_the_log(
    server: Server, session: str, tmp_path: Path
) -> None:
    levels = [(0, 101), (300, 5), (900, 102), (1_500, 6), (3_000, 7), (4_000, 103), (4_100, 104)]
    async with attached(server, session=session, spec="lamp") as monitor:
        for name, kind in (("/light", "topic"), ("/switch", "request"), ("/switch", "response")):
            await monitor.send(make_clock(name, 10**6, kind))
        for seq, (at, level) in enumerate(levels, start=1):
            await monitor.send(make_event(seq, "/battery", at, {"percentage": level}))
        await monitor.send(make_clock("/battery", 10**6))
        await monitor.acked(len(levels))
    told = server.records(session, "violations")
    assert len(told) == 3
    messages, _ = read(recorded(server, session, tmp_path))
    log = of(messages, "/oracle/log/episodes")
    assert {m.schema for m in log} == {"foxglove.Log"}
    times = [(m.data["timestamp"]["sec"] * 10**9 + m.data["timestamp"]["nsec"] - BASE) // MS for m in log]
    assert [(m.data["level"], at, m.data["name"]) for m, at in zip(log, times, strict=True)] == [
        (3, 0, "battery_is_plausible"), (2, 900, "battery_is_plausible"), (3, 4_000, "battery_is_plausible"),
    ]  # fmt: skip
    assert log[0].data["message"] == told[0]["explanation"]["text"]
    assert log[0].time == told[0]["judged"]
    assert log[1].data["message"].endswith("2 violations in 0.900 s")
    assert server.http.delete(f"/api/v1/sessions/{session}").status_code == 200
    closed = of(read(recorded(server, session, tmp_path))[0], "/oracle/log/episodes")
    assert [m.data["level"] for m in closed] == [3, 2, 3, 2], "what is open ends with its session"


async def test_what_was_revised_is_drawn_as_it_stands(server: Server, session: str, tmp_path: Path) -> None:
    async with attached(server, session=session, spec="moving") as monitor:
        await monitor.send(make_event(1, "/odom", data={"v": 0}), make_event(2, "/cmd", at=100))
        await monitor.send(make_clock("/odom", 200), make_clock("/cmd", 200))
        await monitor.violated(1)
        await monitor.send(make_event(3, "/odom", at=50, data={"v": 1}))
        await monitor.acked(3)
    await server.until(lambda: server.records(session, "violations"), lambda found: not found)
    out = recorded(server, session, tmp_path)
    messages, _ = read(out)
    assert not of(messages, "/oracle/log/episodes")
    assert {m.data["outcome"] for m in of(messages, "/oracle/moves")} == {"currently_true"}


def write_as_before(path: Path, lines: list[dict[str, Any]]) -> None:
    """The file as it was written before there was anything to draw."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="oracle-server", library="oracle-server")
        schema = writer.register_schema("oracle_server.Event", "jsonschema", b'{"type": "object"}')
        channels: dict[str, int] = {}
        for line in lines:
            name = f"{line['stream']}/{line['kind']}"
            if name not in channels:
                channels[name] = writer.register_channel(name, "json", schema, {"kind": line["kind"]})
            writer.add_message(channels[name], line["arrived"], msgspec.json.encode(line), line["stamp"], line["seq"])
        writer.finish()  # type: ignore[no-untyped-call]


async def test_files_of_older_versions_are_judged_the_same(server: Server, session: str, tmp_path: Path) -> None:
    await live(server, session, "lamp", random.Random(3))
    text = server.http.get(f"/api/v1/sessions/{session}/trace").text
    lines = [json.loads(line) for line in text.splitlines()]
    for line in lines:
        line.pop("decision", None)
        line.pop("denied_by", None)
    write_as_before(tmp_path / "old.mcap", lines)
    replayed = run("replay", spec_of("lamp"), tmp_path / "old.mcap", "--json")
    *records, _ = map(json.loads, replayed.stdout.splitlines())
    assert comparable(records) == comparable(server.records(session))


async def test_a_damaged_file_is_judged_as_far_as_it_goes(server: Server, session: str, tmp_path: Path) -> None:
    """Nothing that is only drawn is taken for an event, whatever is missing."""
    await live(server, session, "both", random.Random(4))
    out = recorded(server, session, tmp_path)
    told, whole = comparable(server.records(session)), out.read_bytes()
    ends = False
    for part in (0.2, 0.5, 0.9, 0.99):
        out.write_bytes(whole[: int(len(whole) * part)])
        replayed = run("replay", spec_of("both"), out, "--json")
        assert replayed.returncode in (0, 1, 2), replayed.stderr
        assert "not an event" not in replayed.stderr
        if replayed.returncode < 2:
            *records, last = map(json.loads, replayed.stdout.splitlines())
            assert comparable(records) == told[: len(records)]
            assert "ends early" in str(last["summary"]["notes"])
            ends = True
    assert ends


def test_a_session_that_is_not_known_leaves_no_file(server: Server, tmp_path: Path) -> None:
    assert "no session 'nothing'" in failed("record", "nothing", "-o", tmp_path / "x.mcap", "--url", server.url)
    assert server.http.get("/api/v1/sessions/nothing/changes").status_code == 404
    assert list(tmp_path.iterdir()) == []
