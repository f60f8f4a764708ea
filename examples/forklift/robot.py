"""A forklift without ROS: it reports its fork, asks for each speed, and finds which of several servers has its session.

    python3 robot.py --oracle http://a:8642,http://b:8642,http://c:8642 --session robot1

It says at the end what it was told; with `--told FILE` each decision is a line of a file, as it comes.
"""

from __future__ import annotations

import argparse
import json
import sys
import threading
import time
from contextlib import ExitStack
from functools import partial
from typing import IO

from oracle_adapter import Answer, Link, LinkError

UP_FOR = 20
"""Events for which the fork is up, or down."""
PATIENCE = 30.0
"""Seconds that a speed may wait for its decision, and the last events for their acks."""


class Robot:
    """One forklift on its link; decisions come in the link's thread."""

    def __init__(self, link: Link, told: IO[str] | None) -> None:
        self._link, self._told = link, told
        self._changed = threading.Condition()
        self.asked = self.allowed = self.denied = self.unanswered = 0
        self.longest = 0.0
        """Seconds that a decision took at most."""

    def move(self, number: int) -> None:
        """Report the fork, or ask whether a speed may be commanded; number counts from 1."""
        raised = number // UP_FOR % 2 == 1
        if number % 2:
            self._link.send("/fork", "topic", time.time_ns(), {"data": 1.5 if raised else 0.1})
            return
        self.asked += 1
        data = {"data": 1.6 if number % 8 else 0.7}
        then = partial(self._hear, number, time.monotonic())
        self._link.ask_then("/speed", "topic", time.time_ns(), data, then, decide_within=PATIENCE)

    def finish(self, count: int) -> bool:
        """Wait until so many events are acked and all is answered; whether they are."""
        end = time.monotonic() + PATIENCE
        with self._changed:
            while self._link.stats().acked < count or self._heard < self.asked:
                if time.monotonic() > end:
                    return False
                self._changed.wait(0.05)  # nobody is told of an ack
        return self.unanswered == 0

    @property
    def _heard(self) -> int:
        return self.allowed + self.denied + self.unanswered

    def _hear(self, number: int, asked: float, answer: Answer) -> None:
        allowed = answer.decision == "allow"
        self._link.handled(answer, allowed, answer.why)
        waited = time.monotonic() - asked
        with self._changed:
            self.longest = max(self.longest, waited)
            self.allowed += allowed
            self.denied += answer.decision == "deny"
            self.unanswered += answer.decision is None
            self._changed.notify_all()
        if self._told is not None:
            self._told.write(json.dumps({"seq": number, "decision": answer.decision}) + "\n")
            self._told.flush()


def main() -> int:
    """Drive, and return 0 where all was acked and answered."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--oracle", required=True, help="one server, or several, separated by commas")
    parser.add_argument("--session", required=True)
    parser.add_argument("--events", type=int, default=0, help="0: without an end")
    parser.add_argument("--rate", type=float, default=50.0, help="events a second")
    parser.add_argument("--told", help="a file for what is told")
    options = parser.parse_args()
    with ExitStack() as stack:
        told = stack.enter_context(open(options.told, "w", encoding="utf-8")) if options.told else None
        link = Link(options.oracle, "robot", spec="forklift", session=options.session)
        robot = Robot(link, told)
        try:
            stack.enter_context(link)
            link.wait_attached(PATIENCE)
        except LinkError as error:
            print(f"{options.session}: {error}", file=sys.stderr)
            return 1
        print(f"{options.session}: attached", flush=True)
        begun, number = time.monotonic(), 0
        while number != options.events:
            number += 1
            time.sleep(max(0.0, begun + number / options.rate - time.monotonic()))
            robot.move(number)
        done, stats = robot.finish(number), link.stats()
    print(
        f"{options.session}: {stats.acked} of {number} events acked; of {robot.asked} speeds {robot.allowed} allowed, "
        f"{robot.denied} denied, {robot.unanswered} unanswered, after {robot.longest:.1f} s at most; "
        f"{stats.reconnects} reconnects"
    )
    return 0 if done else 1


if __name__ == "__main__":
    sys.exit(main())
