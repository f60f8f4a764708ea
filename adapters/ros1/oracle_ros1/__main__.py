"""`python3 -m oracle_ros1`: attach this machine's ROS 1 graph to an oracle server."""

from __future__ import annotations

import sys
from typing import Optional, Sequence

from oracle_ros1.stopping import Stopping


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run until SIGINT, SIGTERM or SIGHUP.

    0 after a clean stop, 2 where it can't start, is refused, or is replaced.
    """
    stopping = Stopping()
    try:
        from oracle_ros1.program import run  # takes a second, in which a signal may come
    except ImportError as error:
        hint = ": ROS 1 is not there for this Python, source its setup.bash or install python3-rospy"
        sys.stderr.write(f"{error}{hint if error.name == 'rospy' else ''}\n")
        return 2
    return run(sys.argv if arguments is None else arguments, stopping)


if __name__ == "__main__":
    sys.exit(main())
