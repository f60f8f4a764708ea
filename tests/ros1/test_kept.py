"""What a latching publisher has kept since before an adapter began stands where it came."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

from genpy import Time
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from tests.processes import eventually
from tests.robot import spec_folder
from tests.ros1.harness import Scene

SPEC = """
id: maps
streams:
  - {topic: /map, type: std_msgs/Header}
  - {topic: /scan, type: std_msgs/Header}
properties: [{id: some, formula: 'once {topic: "/map"}'}]
"""
HOUR = 3_600 * 10**9


def header(stamp: int) -> Header:
    return Header(stamp=Time(*divmod(stamp, 10**9)))


def test_what_was_kept_stands_where_it_came_and_all_else_by_its_stamp(tmp_path: Path) -> None:
    """By its stamp all that nobody heard yet would be missing in that hour."""
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        peer, long_ago = scene.peer(), time.time_ns() - HOUR
        peer.advertise(Header, "/map", listeners=0, latch=True)
        peer.publish("/map", header(long_ago))
        started = time.time_ns()
        scene.adapter("maps")

        def stamps(stream: str, count: int) -> list[int]:
            found = eventually(lambda: scene.server.events("s", stream=stream), lambda events: len(events) == count)
            return [event["stamp"] for event in found]

        assert stamps("/map", 1)[0] > started
        now = time.time_ns()
        peer.publish("/map", header(now))
        assert stamps("/map", 2)[1] == now
        peer.advertise(Header, "/scan")
        peer.publish("/scan", header(long_ago))
        assert stamps("/scan", 1) == [long_ago]


def test_so_it_is_in_simulated_time_that_is_told_later_and_goes_back(tmp_path: Path) -> None:
    """As that of a bag: it is played once the adapter runs, and again."""
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        peer = scene.peer()
        peer.parameter("/use_sim_time", True)
        adapter = scene.adapter("maps")
        peer.advertise(Clock, "/clock")
        peer.advertise(Header, "/map", latch=True)

        def frontier(session: str) -> int | None:
            known = {one["id"] for one in scene.server.get("sessions")["items"]}
            return scene.server.session(session)["streams"][0]["frontier"] if session in known else None

        def at(time: int, session: str) -> None:
            """Set the time, and wait until the session has heard of it."""
            peer.publish("/clock", Clock(Time(*divmod(time, 10**9))))
            eventually(partial(frontier, session), lambda found: found is not None and 0 <= time - found < 10**9)

        def taken(session: str) -> int:
            return int(scene.server.session(session)["monitors"][0]["next"])

        def say(stamp: int, session: str) -> None:
            """Publish a map, and wait until the session has it: it must come before time goes on."""
            before = taken(session)
            peer.publish("/map", header(stamp))
            eventually(partial(taken, session), lambda after: after > before)

        for session, began in (("s", 10 * HOUR), ("s.run2", 5 * HOUR)):
            at(began, session)
            say(began - HOUR, session)
            at(began + 2 * 10**9, session)
            say(began + 10**9, session)
            at(began + 4 * 10**9, session)
            found = eventually(partial(scene.server.events, session, stream="/map"), lambda events: len(events) == 2)
            assert [event["stamp"] for event in found] == [began, began + 10**9]
        adapter.ends_well()
