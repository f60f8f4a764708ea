"""A process that brings a robot's history to the centre, a chunk each time that it is asked."""

from __future__ import annotations

import logging
import os
import sqlite3
import sys

import msgspec
import structlog

from oracle_server.core.errors import OracleError
from oracle_server.history.forwarding.centre import Centre, Wrote
from oracle_server.history.forwarding.messages import Ask, Told
from oracle_server.history.forwarding.robot import Robot
from oracle_server.process.worker import receive, send, step_back

_NICE = 10
_ask = msgspec.msgpack.Decoder(Ask).decode


class Bringing:
    """What is kept between two questions: connections, until something fails."""

    def __init__(self) -> None:
        self._robot: Robot | None = None
        self._centre: Centre | None = None

    def bring(self, ask: Ask) -> Told:
        """Bring some more, and tell what."""
        try:
            return self._brought(ask)
        except (OracleError, ValueError) as error:
            self.close()
            return Told(error=str(error))
        except sqlite3.Error as error:
            self.close()
            return Told(error=f"{os.fsdecode(ask.path)}: can't be read: {error}")

    def close(self) -> None:
        """Let go of both histories."""
        for each in (self._robot, self._centre):
            if each is not None:
                each.close()
        self._robot = self._centre = None

    def _brought(self, ask: Ask) -> Told:
        new = False
        if self._robot is None or self._centre is None:
            self._robot = Robot(os.fsdecode(ask.path))
            self._centre = Centre(ask.url, ask.origin, ask.robot)
            new = True
            if not self._robot.begin(self._centre.known, self._centre.seq):
                self.close()
                return Told(anew="other")
            if self._centre.seq < ask.seq:
                self._centre.begin_anew()
                self.close()
                return Told(anew="less")
            self._centre.end(self._robot.gone(self._centre.known))
        robot, centre = self._robot, self._centre
        chunk = robot.read(centre.cursors, centre.seq, ask.rows)
        wrote = Wrote()
        if chunk.rows or chunk.seq > centre.seq or centre.is_behind:
            wrote = centre.write(chunk)
        else:
            centre.demand_held()
        sessions = centre.places if new else [page.session for page in chunk.pages]
        reached = {number: centre.places[number].position for number in sessions}
        return Told(chunk.rows, chunk.seq, reached, chunk.left, chunk.oldest, *wrote, shared=new and centre.shared)


def main() -> None:
    """Answer on the standard output what is asked on the standard input, until its end."""
    step_back(_NICE)
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # nothing else may be written among the answers
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.WARNING))
    bringing = Bringing()
    while request := receive(sys.stdin.buffer):
        try:
            send(answers, bringing.bring(_ask(request)))
        except BrokenPipeError:
            return


if __name__ == "__main__":
    main()
