"""The simulated UAV: its recorded traces, its order, its faults."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import pytest

from examples.battery_uav import simulator
from examples.battery_uav.simulator import FAULTS, MS, Publication, arrivals, simulate

TRACES = Path(simulator.__file__).parent / "traces"

Fact = tuple[object, ...]


def test_the_recorded_traces_are_what_the_simulator_makes() -> None:
    on_disk = {path.stem: path.read_bytes() for path in TRACES.iterdir()}
    assert on_disk == {name: text.encode() for name, text in simulator.recorded().items()}


@pytest.mark.parametrize("seed", range(5))
def test_stamps_are_distinct_and_in_order(seed: int) -> None:
    stamps = [sent.stamp for sent in simulate(seed=seed, countdowns=3)]
    assert stamps == sorted(set(stamps))


def test_headers_carry_the_stamp() -> None:
    for sent in simulate():
        if sent.kind == "topic":
            data: Any = sent.data
            stamp = data["header"]["stamp"]
            assert stamp["sec"] * 10**9 + stamp["nanosec"] == sent.stamp


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("jitter", [0, 1, 150 * MS])
def test_jitter_keeps_every_publishers_own_order(jitter: int, seed: int) -> None:
    sent = simulate(seed=seed)
    lines: list[dict[str, Any]] = arrivals(sent, jitter, seed)
    assert [line["arrived"] for line in lines] == sorted(line["arrived"] for line in lines)
    assert all(0 <= line["arrived"] - line["stamp"] <= jitter for line in lines)
    stamps = defaultdict(list)
    for line in lines:
        stamps[line["stream"], line["kind"]].append(line["stamp"])
    assert all(of_stream == sorted(of_stream) for of_stream in stamps.values())
    assert sorted(line["stamp"] for line in lines) == [publication.stamp for publication in sent]


def test_a_response_arrives_after_its_request() -> None:
    calls = [line for line in read("shuffled") if line["stream"] == "/SetLED"]
    assert [line["kind"] for line in calls] == ["request", "response"] * 3
    assert [line["call"] for line in calls] == [1, 1, 2, 2, 3, 3]


def test_in_order_traces_arrive_as_published() -> None:
    lines = read("in_order")
    stamps = [line["stamp"] for line in lines]
    assert stamps == sorted(stamps)
    assert all(0 <= line["arrived"] - line["stamp"] <= MS for line in lines)


def test_the_shuffled_trace_is_the_ordered_one_delayed() -> None:
    shuffled, ordered = read("shuffled"), read("in_order")
    assert [line["stamp"] for line in shuffled] != [line["stamp"] for line in ordered]
    for line in (*shuffled, *ordered):
        del line["arrived"]
    assert sorted(shuffled, key=lambda line: line["stamp"]) == ordered


def test_countdowns_go_on_with_new_ids() -> None:
    percentages = [sent.data for sent in simulate(countdowns=2) if "percentage" in sent.data]
    assert [data["id"] for data in percentages] == list(range(1, 203))
    assert [data["percentage"] for data in percentages] == [*range(100, -1, -1)] * 2
    requests = [sent.data for sent in simulate(countdowns=2) if sent.kind == "request"]
    assert [data["status"] for data in requests] == [1, 2, 3, 1, 2, 3]


def test_events_cuts_the_trace() -> None:
    assert simulate(countdowns=3, events=400) == simulate(countdowns=3)[:400]


def test_an_unknown_fault_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown fault 'rust'; there are wrong_status"):
        simulate(fault="rust")


def test_the_command_writes_one_trace(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    chosen = "--fault silent_panel --jitter 0.15s --seed 7 --countdowns 2 --events 500"
    monkeypatch.setattr("sys.argv", ["simulator.py", *chosen.split()])
    simulator.main()
    sent = simulate(fault="silent_panel", seed=7, countdowns=2, events=500)
    assert capsys.readouterr().out == simulator.trace(sent, 150 * MS, 7)


def test_wrong_status_changes_one_word() -> None:
    lost, gained = difference("wrong_status")
    assert [said["status"] for said in lost["/battery_status"]] == [1]
    assert [said["status"] for said in gained["/battery_status"]] == [2]
    for said in (*lost["/battery_status"], *gained["/battery_status"]):
        assert said["id"] == 51
        assert not said["status_change"]
    assert set(lost) == set(gained) == {"/battery_status"}


def test_status_without_cause_adds_one_status() -> None:
    lost, gained = difference("status_without_cause")
    assert not lost
    assert [said["id"] for said in gained.pop("/battery_status")] == [0]
    assert not gained


def test_request_without_change_adds_one_answered_call() -> None:
    lost, gained = difference("request_without_change")
    assert gained.pop("/SetLED") == [{"id": 51, "status": 1}, {"success": True, "id": 51}]
    assert [said["id"] for said in gained.pop("/status_accepted")] == [51]
    assert {said["id"] for said in lost["/LED_panel"]} == {1}
    assert {said["id"] for said in gained["/LED_panel"]} == {51}
    assert lights(lost) == lights(gained) == {"green"}
    assert set(lost) == set(gained) == {"/LED_panel"}


def test_silent_panel_ignores_one_request() -> None:
    lost, gained = difference("silent_panel")
    assert lost.pop("/SetLED") == [{"success": True, "id": 61}]
    assert [said["id"] for said in lost.pop("/status_accepted")] == [61]
    assert lights(lost) == {"yellow"}
    assert lights(gained) == {"green"}
    assert set(lost) == set(gained) == {"/LED_panel"}


@pytest.mark.parametrize(
    ("trace", "expected"),
    [
        ("in_order", []),
        ("fault_wrong_status", [(167, "status_matches_percentage")]),
        ("fault_status_without_cause", [(168, "status_matches_percentage")]),
        ("fault_request_without_change", [(168, "request_has_a_cause")]),
        ("fault_silent_panel", [(300, "request_is_followed_by_response")]),
    ],
)
def test_a_fault_breaks_its_own_property_alone(trace: str, expected: list[tuple[int, str]]) -> None:
    assert turned_negative(read(trace)) == expected


@pytest.mark.parametrize("seed", range(1, 6))
def test_other_seeds_break_the_same_properties(seed: int) -> None:
    assert not turned_negative(as_lines(simulate(seed=seed, countdowns=3)))
    for fault in FAULTS:
        broken = turned_negative(as_lines(simulate(fault=fault, seed=seed)))
        recorded = turned_negative(read(f"fault_{fault}"))
        assert [name for _, name in broken] == [name for _, name in recorded]


def test_the_shuffled_trace_raises_false_alarms_by_arrival() -> None:
    alarms = turned_negative(read("shuffled"))
    assert alarms[0] == (5, "status_matches_percentage")
    assert (231, "request_has_a_cause") in alarms
    assert Counter(name for _, name in alarms) == {
        "status_matches_percentage": 16,
        "request_has_a_cause": 1,
    }


def read(trace: str) -> list[dict[str, Any]]:
    text = (TRACES / f"{trace}.jsonl").read_text(encoding="utf-8")
    return [json.loads(line) for line in text.splitlines()]


def as_lines(publications: list[Publication]) -> list[dict[str, Any]]:
    return [json.loads(line) for line in simulator.trace(publications).splitlines()]


Said = dict[str, list[dict[str, Any]]]


def difference(fault: str) -> tuple[Said, Said]:
    """What a fault takes away and what it adds, by stream; a call's number is no matter."""
    plain, faulty = simulate(), simulate(fault=fault)
    return without(plain, faulty), without(faulty, plain)


def without(left: list[Publication], right: list[Publication]) -> Said:
    known = [(sent.stamp, sent.stream, sent.kind, sent.data) for sent in right]
    said: Said = defaultdict(list)
    for sent in left:
        if (sent.stamp, sent.stream, sent.kind, sent.data) not in known:
            said[sent.stream].append(sent.data)
    return said


def lights(said: Said) -> set[str]:
    return {message["light"] for message in said["/LED_panel"]}


def turned_negative(lines: list[dict[str, Any]]) -> list[tuple[int, str]]:
    """The six properties read in plain Python: the steps at which one turns negative."""
    seen: set[Fact] = set()
    missing: dict[Fact, tuple[str, int]] = {}  # effects that have not come: property and last step
    before: set[str] = set()
    turned = []
    for step, line in enumerate(lines, 1):
        facts = facts_of(line)
        seen |= facts
        negative = set()
        for fact in facts:
            missing.pop(fact, None)
            name, causes = causes_of(fact)
            if not causes <= seen:
                negative.add(name)
            name, effects = effects_of(fact)
            missing |= dict.fromkeys(effects - seen - set(missing), (name, step + 100))
        negative |= {name for name, last in missing.values() if last <= step}
        turned += [(step, name) for name in sorted(negative - before)]
        before = negative
    return turned


def facts_of(line: dict[str, Any]) -> set[Fact]:
    data = line["data"]
    match line["stream"], line["kind"]:
        case "/battery_percentage", _:
            return {("percentage", data["id"], simulator.status_of(data["percentage"]))}
        case "/input_accepted", _:
            return {("accepted", data["id"])}
        case "/battery_status", _:
            facts: set[Fact] = {("status", data["id"]), ("status", data["id"], data["status"])}
            return facts | ({("change", data["id"], data["status"])} if data["status_change"] else set())
        case "/SetLED", "request":
            return {("request", data["id"]), ("request", data["id"], data["status"])}
        case "/SetLED", "response":
            return {("response", data["id"])}
    return set()


def causes_of(fact: Fact) -> tuple[str, set[Fact]]:
    match fact:
        case ("status", ident, status):
            causes: set[Fact] = {("accepted", ident), ("percentage", ident, status)}
            return "status_matches_percentage", causes
        case ("request", ident, status):
            return "request_has_a_cause", {("change", ident, status)}
        case ("response", ident):
            return "response_has_a_request", {("request", ident)}
    return "", set()


def effects_of(fact: Fact) -> tuple[str, set[Fact]]:
    match fact:
        case ("accepted", ident):
            return "input_is_followed_by_status", {("status", ident)}
        case ("change", ident, status):
            return "change_is_followed_by_request", {("request", ident, status)}
        case ("request", ident):
            return "request_is_followed_by_response", {("response", ident)}
    return "", set()
