"""`python3 -m oracle_ros2`: attach this machine's ROS 2 graph to an oracle server."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT, SIGTERM or SIGHUP.

    0 after a clean stop, 2 where it can't start or the server refused it.
    """
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # as by `nohup`
            signal.signal(number, lambda *_: stopping.set())
    try:
        from oracle_ros2.program import run  # takes half a second, in which a signal may come
    except ImportError as error:
        hint = ": ROS 2 is not there for this Python, source its setup.bash" if error.name == "rclpy" else ""
        sys.stderr.write(f"{error}{hint}\n")
        return 2
    return run(sys.argv if arguments is None else arguments, stopping)


if __name__ == "__main__":
    sys.exit(main())
