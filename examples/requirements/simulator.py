"""What the twelve robots say, each in a sound run and in faulty ones. Writes the recordings of `traces/`.

    python examples/requirements/simulator.py

A run is a function of its fault (None: a sound one), which yields messages at their times in seconds. `trace` delays
them on their way, so that they arrive in another order than that in which they were published; of each stream they stay
in order.
"""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

START = 1_763_800_000 * 10**9
MS = 10**6
FOLDER = Path(__file__).parent


class Message(NamedTuple):
    """One message: when it was published, in seconds since the start, its stream and fields; of a service its call."""

    time: float
    stream: str
    data: dict[str, Any]
    kind: str = "topic"
    call: int | None = None


Run = Callable[[random.Random, str | None], Iterator[Message]]


def every(dice: random.Random, hz: float, start: float, end: float) -> Iterator[float]:
    """The times of a publisher at a rate, each up to a tenth of its period late."""
    for number in range(int((end - start) * hz)):
        yield start + (number + dice.random() / 10) / hz


def stamp(time: float) -> int:
    """A time of a run, in nanoseconds since the epoch; whole microseconds, so that sums of times are exact."""
    return START + round(time * 10**6) * 1000


def header(time: float, frame: str) -> dict[str, Any]:
    """The header of a message that is stamped at a time of the run."""
    return {"stamp": {"sec": stamp(time) // 10**9, "nanosec": stamp(time) % 10**9}, "frame_id": frame}


def odometry(time: float, vx: float, vy: float = 0.0) -> Message:
    """How it goes: at `vx`, `vy` in m/s."""
    return Message(time, "/odom", {"twist": {"twist": {"linear": {"x": round(vx, 3), "y": vy}}}})


def command(time: float, vx: float) -> Message:
    """A command to drive."""
    return Message(time, "/cmd_vel", {"twist": {"linear": {"x": round(vx, 3)}, "angular": {"z": 0.0}}})


def value(time: float, stream: str, data: bool | float | str) -> Message:
    """A message of std_msgs with one field."""
    return Message(time, stream, {"data": data})


def battery(time: float, level: float, current: float = -4.0, charging: bool = False) -> Message:
    """The state of a battery: its level in percent, its current in A."""
    fields = {
        "percentage": round(level / 100, 4),
        "current": round(current, 2),
        "power_supply_status": 1 + (not charging),
    }
    return Message(time, "/battery_state", fields)


def r01_speed_limit(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """The limit goes down from 1 to 0.3 m/s in a narrow aisle, and up again."""
    limits = [(0.1, 1.0), (4.0, 0.3), (8.0, 0.8)]
    for time, limit in limits:
        if not (fault == "no_limit" and time < 1):
            yield value(time, "/speed_limit", limit)
    slows_down = 4.45 if fault == "late_braking" else 4.0
    for time in every(dice, 20, 0.2, 12):
        speed = 0.9 if time < slows_down else 0.3 if time < 8 else 0.8
        if fault == "fast_reverse" and 9 <= time < 9.2:
            speed = -0.85
        yield command(time, 0.0 if time < 1 and fault != "no_limit" else speed)


def r02_scan_rate(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """A scanner of 12 Hz, of which single scans are lost."""
    for time in every(dice, 12, 0.02, 15):
        lost = 4 < time < 4.2 or 9 < time < 9.1
        stopped = (fault == "stops" and time > 7) or (fault == "pauses" and 7 < time < 8)
        if not lost and not stopped and not (fault == "slow" and time > 6):
            yield Message(time, "/scan", {})
    if fault == "slow":
        for time in every(dice, 8, 6.05, 15):
            yield Message(time, "/scan", {})
    for time in every(dice, 10, 0.0, 15):
        yield odometry(time, 0.5)


def r03_goals_answered(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """Goals that succeed (3), are preempted by the next (2), or aborted (4); one is answered after 60 s exactly."""
    goals = [
        ("g1", 2.0, 31.5, 3),
        ("g2", 35.0, 95.25 if fault == "late" else 95.0, 3),
        ("g3", 100.0, 112.0, 2),
        ("g4", 111.9, 150.0, 4),
    ]
    goals += [("g5", 152.0, 160.0, 3), ("g6", 200.0, 230.0, 3)]
    for goal, sent, answered, status in goals:
        yield Message(sent, "/move_base/goal", {"goal_id": {"id": goal}})
        ignored = {"ignored": ("g1",), "two_ignored": ("g3", "g4"), "unfinished": ("g6",)}.get(fault or "", ())
        if goal not in ignored:
            ident = "g7" if goal == "g5" and fault == "unknown_goal" else goal
            fields = {"goal_id": {"id": ident}, "status": status}
            yield Message(answered, "/move_base/result", {"status": fields})
        if goal == "g5" and fault == "unknown_goal":
            yield Message(161.0, "/move_base/result", {"status": {"goal_id": {"id": goal}, "status": 3}})
    for time in every(dice, 1, 0.0, 240):
        yield odometry(time, 0.5)


def r04_estop(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """Two emergency stops, each reset; the drive tells ten times a second, and when it changes."""
    stops = [(3.0, 3.12, 6.0), (10.0, 10.2, 14.0)]
    if fault == "slow":
        stops[1] = (10.0, 10.26, 14.0)
    for pressed, off, reset in stops:
        yield value(pressed, "/estop", data=True)
        yield value(off, "/drive_enabled", data=False)
        yield value(reset - 0.5, "/estop", data=False)
        yield Message(reset, "/estop_reset", {})
    if fault == "on_again":
        yield value(5.7, "/drive_enabled", data=True)
    for time in every(dice, 10, 0.01, 18):
        stopped = any(off <= time < reset + 0.1 for _, off, reset in stops)
        again = fault == "on_again" and 5.7 <= time < 6
        if not any(pressed <= time < off for pressed, off, _ in stops):
            yield value(time, "/drive_enabled", data=not stopped or again)
    for time in every(dice, 5, 0.0, 18):
        if not any(pressed <= time < reset - 0.5 for pressed, _, reset in stops):
            yield value(time, "/estop", data=False)
        elif not any(time < pressed + 0.25 and time >= pressed for pressed, _, _ in stops):
            yield value(time, "/estop", data=True)


def r05_door(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """The door is opened at 5 s, and closed at 9 s; the base needs 0.4 s to stand."""
    for time in every(dice, 2, 2.0 if fault == "door_not_known" else 0.0, 14):
        yield value(time, "/cell/door_open", data=5 <= time < 9)
    yield value(5.0, "/cell/door_open", data=True)
    yield value(9.0, "/cell/door_open", data=False)
    wrong = fault == "command_while_open"
    for time in every(dice, 10, 0.55, 14):
        yield command(time, 0.0 if 5 <= time < 9.05 and not (wrong and 7 <= time < 7.3) else 0.4)
    stands = 6.2 if fault == "rolls_on" else 5.4
    for time in every(dice, 20, 0.0, 14):
        yield odometry(time, 0.0 if time < 0.6 or stands <= time < 9.1 else 0.4 if time < 5 or time > 9 else 0.2)


def r06_transform_age(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """Localisation sends map→odom at 10 Hz, with a pause of 0.4 s; odom→base_link comes at 20 Hz on the same topic."""

    def transform(time: float, parent: str, child: str, at: float) -> Message:
        return Message(time, "/tf", {"transforms": [{"header": header(at, parent), "child_frame_id": child}]})

    for time in every(dice, 10, 0.05, 10):
        if not (3 < time < 3.3 or (fault == "silent" and time > 6)):
            yield transform(time, "map", "odom", min(time, 6.0) if fault == "old_stamps" else time)
    for time in every(dice, 20, 0.0, 10):
        yield transform(time, "odom", "base_link", time)
        yield Message(time + 0.002, "/odom", {"header": header(time + 0.002, "odom")})


def r07_battery(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """A battery that drops by 3 % a minute, with peaks of the current of 2 s."""
    level = 64.0
    for time in every(dice, 2, 0.0, 130):
        weak = fault == "weak_cell" and 70 <= time < 76
        level -= 0.5 if weak else 0.025
        long = fault == "stuck_wheel" and 90 <= time < 98
        peak = 30 <= time < 32 or 60 <= time < 62 or long
        yield battery(time, level, -34.0 if peak else -9 - 2 * dice.random())


def r08_heartbeats(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """Three nodes with a heartbeat of 4 Hz; the recorder says at 6 s that it ends."""

    def beat(time: float, node: str, *, active: bool = True) -> Message:
        return Message(time, "/bond", {"id": node, "active": active})

    for node, end in (("planner", 12.0), ("controller", 12.0), ("recorder", 6.0)):
        for time in every(dice, 4, 0.03, end):
            dead = fault == "planner_dies" and node == "planner" and time > 7
            hung = fault == "controller_hangs" and node == "controller" and 5 < time < 7.5
            if not dead and not hung:
                yield beat(time, node)
    if fault != "no_farewell":
        yield beat(6.0, "recorder", active=False)
    for time in every(dice, 10, 0.0, 12):
        yield odometry(time, 0.5)


def r09_distance(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """The base slows down before a wall, and the arm moves meanwhile."""
    for time in every(dice, 10, 0.0, 10):
        ahead = round(max(0.4, 4 - 0.5 * time), 3)
        fields = {"ranges": ["Infinity", ahead, ahead + 0.2, "Infinity"], "range_max": 12.0}
        yield Message(time, "/scan", fields)
    for time in every(dice, 20, 0.15, 10):
        speed = max(0.15, 1.8 - 0.27 * time)
        yield odometry(time, 0.9 if fault == "too_fast" and 6 <= time < 6.3 else speed, 0.05)
    for time in every(dice, 25, 0.0, 10):
        elbow = 2.7 if fault == "elbow_beyond" and 5 <= time < 5.2 else 0.2 * time
        names, positions = ["shoulder", "elbow"], [round(1.5 - 0.3 * time, 3), round(elbow, 3)]
        if fault == "other_order" and 8 <= time < 8.05:
            names, positions = names[::-1], positions[::-1]
        yield Message(time, "/joint_states", {"name": names, "position": positions})


def r10_docking(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """The level falls below 20 % at 21 s; it is charged from 75 s on."""
    charges = 75.0
    for time in every(dice, 1, 0.0, 200):
        charging = time >= charges and fault != "no_contact"
        level = 21 - 0.05 * time if not charging else 16 + 0.65 * (time - charges)
        yield battery(time, min(level, 100), 6.0 if charging else -8.0, charging)
    if fault != "never_told":
        asked = 38.0 if fault == "told_late" else 25.5
        yield Message(asked, "/dock", {}, "request", 1)
        yield Message(asked + 0.02, "/dock", {"success": True, "message": ""}, "response", 1)
    goals = [5.0, 12.0, 190.0] + ([60.0] if fault == "takes_a_goal" else [])
    for time in goals:
        yield Message(time, "/goal_pose", {"pose": {"position": {"x": 1.0, "y": 2.0}}})


def r11_localisation(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """The position gets uncertain in a long corridor, and the robot waits until it knows more."""
    for time in every(dice, 2, 0.2, 16):
        uncertain = 5 <= time < 8
        variance = 0.25 if uncertain else 0.01
        covariance = [0.0] * 36
        covariance[0] = covariance[7] = variance
        if fault != "no_pose":
            yield Message(time, "/amcl_pose", {"pose": {"covariance": covariance}})
    stops = 7.0 if fault == "goes_on" else 5.8
    for time in every(dice, 20, 0.0, 16):
        yield odometry(time, 0.0 if time < 0.5 or stops <= time < 8.7 else 0.5)


def r12_pick_and_place(dice: random.Random, fault: str | None) -> Iterator[Message]:
    """Two arms at work on four objects; what one does overlaps with what the other does."""
    slow = fault == "slow_lift"
    work = [
        ("a", 2.0, 6.0, 14.0),
        ("b", 4.0, 14.5 if slow else 14.0, 24.0),
        ("c", 20.0, 25.0, 31.0),
        ("d", 28.0, 33.0, 40.0),
    ]
    for thing, picked, lifted, placed in work:
        yield value(picked, "/pick", thing)
        yield value(lifted, "/lift", thing)
        if not (fault == "kept" and thing == "c"):
            yield value(placed, "/place", "c" if fault == "wrong_one" and thing == "d" else thing)
    for time in every(dice, 5, 0.0, 55):
        width = 0.03 if any(picked <= time <= placed for _, picked, _, placed in work) else 0.08
        if fault == "empty_gripper" and 32 <= time < 34:
            width = 0.0
        yield Message(time, "/gripper_state", {"position": [width]})


RUNS: dict[Run, tuple[str, ...]] = {
    r01_speed_limit: ("late_braking", "no_limit", "fast_reverse"),
    r02_scan_rate: ("slow", "stops", "pauses"),
    r03_goals_answered: ("ignored", "two_ignored", "late", "unknown_goal", "unfinished"),
    r04_estop: ("slow", "on_again"),
    r05_door: ("command_while_open", "door_not_known", "rolls_on"),
    r06_transform_age: ("silent", "old_stamps"),
    r07_battery: ("weak_cell", "stuck_wheel"),
    r08_heartbeats: ("planner_dies", "controller_hangs", "no_farewell"),
    r09_distance: ("too_fast", "elbow_beyond", "other_order"),
    r10_docking: ("never_told", "told_late", "no_contact", "takes_a_goal"),
    r11_localisation: ("goes_on", "no_pose"),
    r12_pick_and_place: ("slow_lift", "kept", "wrong_one", "empty_gripper"),
}
"""Each run, and the faults that it can have."""


def trace(run: Run, fault: str | None, seed: str = "") -> Iterator[str]:
    """The lines of a recording, in the order of arrival."""
    dice = random.Random(run.__name__ + seed)
    last: dict[str, int] = {}
    lines: list[dict[str, Any]] = []
    for message in sorted(run(dice, fault), key=lambda m: (m.time, m.stream, m.kind)):
        published = stamp(message.time)
        arrived = max(published + dice.randrange(1, 120) * MS, last.get(message.stream, 0) + 1000)
        last[message.stream] = arrived
        of_service = {"kind": message.kind, "call": message.call} if message.call is not None else {}
        lines.append(
            {"stream": message.stream, **of_service, "stamp": published, "arrived": arrived, "data": message.data}
        )
    for line in sorted(lines, key=lambda entry: entry["arrived"]):
        yield json.dumps(line)


def recordings() -> Iterator[tuple[str, str, Iterator[str]]]:
    """Each requirement, the name of each of its recordings, and its lines."""
    for run, faults in RUNS.items():
        for fault in (None, *faults):
            yield run.__name__, fault or "sound", trace(run, fault)


if __name__ == "__main__":
    for requirement, name, lines in recordings():
        path = FOLDER / "traces" / requirement / f"{name}.jsonl"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(f"{line}\n" for line in lines))
