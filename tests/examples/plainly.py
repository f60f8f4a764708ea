"""The twelve requirements of examples/requirements, read in plain Python: what is violated when, and about which steps.

Nothing of the server is used here. Times are nanoseconds since the epoch.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

MS = 10**6
S = 10**9


class Said(NamedTuple):
    """A message in the order of publication; `step` is its number there."""

    step: int
    time: int
    stream: str
    kind: str
    data: Any


class Wrong(NamedTuple):
    """A violation: of which property, when, and the steps that asked for what did not come."""

    property: str
    time: int
    about: tuple[int, ...] = ()


def read(path: Path) -> list[Said]:
    """The messages of a recording, in the order of publication."""
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    lines.sort(key=lambda line: (line["stamp"], line["arrived"]))
    return [Said(n, x["stamp"], x["stream"], x.get("kind", "topic"), x["data"]) for n, x in enumerate(lines, 1)]


def turns(name: str, judged: Iterable[tuple[int, bool]]) -> Iterator[Wrong]:
    """A violation at each time at which what was fine, or not judged yet, is bad."""
    before = False
    for time, bad in judged:
        if bad and not before:
            yield Wrong(name, time)
        before = bad


def moments(said: list[Said], *more: int) -> list[int]:
    """The times at which something may turn: those of messages, and others within the recording."""
    return sorted({s.time for s in said} | {t for t in more if t <= said[-1].time})


def r01_speed_limit(said: list[Said]) -> Iterator[Wrong]:
    limit, judged = -1.0, []
    for s in said:
        if s.stream == "/speed_limit":
            limit = s.data["data"]
        speed = abs(s.data["twist"]["linear"]["x"]) if s.stream == "/cmd_vel" else 0
        judged.append((s.time, speed > 0 and speed > limit))
    yield from turns("within_limit", judged)


def r02_scan_rate(said: list[Said]) -> Iterator[Wrong]:
    scans = [s.time for s in said if s.stream == "/scan"]
    known = [t for t in moments(said, *(t + 2 * S for t in scans)) if t > said[0].time + 2.2 * S]
    yield from turns("scans_at_10_hz", ((t, sum(t - 2 * S < x <= t for x in scans) < 20) for t in known))


def r03_goals_answered(said: list[Said]) -> Iterator[Wrong]:
    goals = {s.data["goal_id"]["id"]: s for s in said if s.stream == "/move_base/goal"}
    results = [(s.data["status"]["goal_id"]["id"], s.time) for s in said if s.stream == "/move_base/result"]
    for goal, sent in goals.items():
        if not any(g == goal and sent.time <= t <= sent.time + 60 * S for g, t in results):
            yield Wrong("goals_are_answered", min(sent.time + 60 * S, said[-1].time), (sent.step,))
    for goal, time in results:
        if goal not in goals or goals[goal].time > time:
            yield Wrong("results_have_goals", time)


def r04_estop(said: list[Said]) -> Iterator[Wrong]:
    pressed, resets = False, [s.time for s in said if s.stream == "/estop_reset"]
    drive = [(s.time, s.data["data"]) for s in said if s.stream == "/drive_enabled"]
    for s in said:
        if s.stream != "/estop":
            continue
        if s.data["data"] and not pressed:
            reset = min(t for t in resets if t >= s.time)
            offs = [t for t, on in drive if s.time <= t <= s.time + 200 * MS and not on]
            on_again = [t for t, on in drive if on and offs and offs[0] < t < reset]
            if not offs or on_again:
                yield Wrong("off_until_reset", max(s.time + 200 * MS, *on_again[:1], 0), (s.step,))
        pressed = s.data["data"]


def r05_door(said: list[Said]) -> Iterator[Wrong]:
    opened: int | None = None
    known, commands, moves = False, [], []
    for s in said:
        if s.stream == "/cell/door_open":
            known, opened = True, (opened or s.time) if s.data["data"] else None
        drives = s.stream == "/cmd_vel" and s.data["twist"]["linear"]["x"] != 0
        rolls = s.stream == "/odom" and abs(s.data["twist"]["twist"]["linear"]["x"]) > 0.02
        commands.append((s.time, drives and (not known or opened is not None)))
        moves.append((s.time, rolls and opened is not None and s.time - opened >= 500 * MS))
    yield from turns("no_command", commands)
    yield from turns("stands_still", moves)


def r06_transform_age(said: list[Said]) -> Iterator[Wrong]:
    maps = [
        (s.time, t["header"]["stamp"])
        for s in said
        if s.stream == "/tf"
        for t in s.data["transforms"]
        if t["header"]["frame_id"] == "map"
    ]
    times = [t for t, _ in maps]
    known = moments(said, *(t + 500 * MS + 1 for t in times))
    yield from turns(
        "transforms_come", ((t, not any(0 <= t - x <= 500 * MS for x in [said[0].time, *times])) for t in known)
    )
    now = newest = 0
    judged = []
    for s in said:
        if s.stream == "/odom":
            now = s.data["header"]["stamp"]["sec"] * S + s.data["header"]["stamp"]["nanosec"]
        for time, stamp in maps:
            newest = stamp["sec"] * S + stamp["nanosec"] if time == s.time else newest
        judged.append((s.time, bool(now and newest) and now - newest > 500 * MS))
    yield from turns("transforms_are_young", judged)


def r07_battery(said: list[Said]) -> Iterator[Wrong]:
    levels = [(s.time, s.data["percentage"] * 100) for s in said]
    highest = [max(x for u, x in levels if t - 60 * S < u <= t) for t, _ in levels]
    yield from turns("drops_slowly", ((t, top - x > 5) for (t, x), top in zip(levels, highest, strict=True)))
    currents = [(s.time, abs(s.data["current"])) for s in said]
    judged = []
    for t in moments(said, *(s.time + 10 * S for s in said)):
        window = [x for u, x in currents if t - 10 * S < u <= t]
        judged.append((t, math.fsum(window) / len(window) > 20))
    yield from turns("mean_current_is_bounded", judged)


def r08_heartbeats(said: list[Said]) -> Iterator[Wrong]:
    beats = [(s.data["id"], s) for s in said if s.stream == "/bond"]
    for node, s in beats:
        over = s.time + S
        answered = any(n == node and s.time + MS <= other.time <= over for n, other in beats)
        if s.data["active"] and not answered and over < said[-1].time:
            yield Wrong("beats_go_on", over, (s.step,))
    both = [{s.time for n, s in beats if n == node} for node in ("planner", "controller")]
    known = [t for t in moments(said, *(t + S + 1 for t in both[0] | both[1])) if t > said[0].time + 1.2 * S]
    yield from turns("all_are_there", ((t, not all(any(0 <= t - x <= S for x in own) for own in both)) for t in known))


def r09_distance(said: list[Said]) -> Iterator[Wrong]:
    distance, fast, arm = 0.0, [], []
    for s in said:
        if s.stream == "/scan":
            distance = min([float(r) for r in s.data["ranges"]] + [s.data["range_max"]])
        speed = 0.0
        if s.stream == "/odom":
            linear = s.data["twist"]["twist"]["linear"]
            speed = math.sqrt(linear["x"] * linear["x"] + linear["y"] * linear["y"])
        fast.append((s.time, speed > 0.01 and speed > 0.5 * distance))
        joints = dict(zip(s.data["name"], s.data["position"], strict=True)) if s.stream == "/joint_states" else {}
        ordered = not joints or list(joints) == ["shoulder", "elbow"]
        arm.append((s.time, ordered, -1.6 <= joints.get("shoulder", 0) <= 1.6, 0 <= joints.get("elbow", 0) <= 2.6))
    yield from turns("slow_near_obstacles", fast)
    yield from turns("shoulder_in_range", ((t, not (ordered and ok)) for t, ordered, ok, _ in arm))
    yield from turns("elbow_in_range", ((t, not (ordered and ok)) for t, ordered, _, ok in arm))


def r10_docking(said: list[Said]) -> Iterator[Wrong]:
    states = [s for s in said if s.stream == "/battery_state"]
    asked = [s.time for s in said if s.stream == "/dock" and s.kind == "request"]
    charging = [s.time for s in states if s.data["power_supply_status"] == 1]
    for before, s in itertools.pairwise(states):
        if not s.data["percentage"] * 100 < 20 <= before.data["percentage"] * 100:
            continue
        told = [t for t in asked if s.time <= t <= s.time + 10 * S]
        if not any(t <= c <= t + 90 * S for t in told for c in charging):
            yield Wrong("docks_when_low", max([s.time + 10 * S] + [t + 90 * S for t in told]), (s.step,))
        full = min(
            (x.time for x in states if x.time > s.time and x.data["percentage"] * 100 >= 80), default=said[-1].time
        )
        goals = [x.time for x in said if x.stream == "/goal_pose" and s.time <= x.time < full]
        if goals:
            yield Wrong("no_goal_before_charged", goals[0], (s.step,))


def r11_localisation(said: list[Said]) -> Iterator[Wrong]:
    speed, deviation, since = 0.0, math.inf, 0
    for s, after in zip(said, [*said[1:], said[-1]], strict=True):
        if s.stream == "/amcl_pose":
            deviation = math.sqrt(max(s.data["pose"]["covariance"][0], s.data["pose"]["covariance"][7]))
        else:
            speed = abs(s.data["twist"]["twist"]["linear"]["x"])
        since = (since or s.time) if speed > 0.05 and not deviation <= 0.4 else 0
        if since and s.time < since + S <= after.time:
            yield Wrong("stops_when_lost", since + S)


def r12_pick_and_place(said: list[Said]) -> Iterator[Wrong]:
    width, judged = 0.0, []
    work = {w: [(s.data["data"], s.time) for s in said if s.stream == w] for w in ("/lift", "/place")}
    for s in said:
        if s.stream == "/gripper_state":
            width = s.data["position"][0]
        judged.append((s.time, s.stream == "/lift" and not 0.005 < width < 0.06))
        if s.stream != "/pick":
            continue
        lifted = [t for thing, t in work["/lift"] if thing == s.data["data"] and s.time <= t <= s.time + 10 * S]
        placed = [t for thing, t in work["/place"] if thing == s.data["data"]]
        if not any(t <= p <= t + 10 * S for t in lifted for p in placed):
            yield Wrong("lifted_and_placed", max([s.time + 10 * S] + [t + 10 * S for t in lifted]), (s.step,))
    yield from turns("closed_before_lift", judged)


READINGS: dict[str, Callable[[list[Said]], Iterator[Wrong]]] = {
    each.__name__: each
    for each in (
        r01_speed_limit, r02_scan_rate, r03_goals_answered, r04_estop, r05_door, r06_transform_age,
        r07_battery, r08_heartbeats, r09_distance, r10_docking, r11_localisation, r12_pick_and_place,
    )
}  # fmt: skip
