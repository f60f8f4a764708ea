"""The arm on the base: it reaches out and is stowed as /arm/stow says, and tells on /arm/stowed whether it is.

    python3 -m navigation.arm --ros-args -p wait_for:=0

It waits for `wait_for` subscriptions to what it tells, one a monitor and one the mission, before it begins.
"""

from rclpy.node import Node
from std_msgs.msg import Bool

from .logic import PERIOD, REACHING
from .node import DEPTH, heard, run, when


class Arm(Node):
    """Stowed to begin with."""

    def __init__(self) -> None:
        super().__init__("arm")
        self._stowed = True
        self._told = self.create_publisher(Bool, "arm/stowed", DEPTH)
        self.create_subscription(Bool, "arm/stow", self._move, DEPTH)
        when(self, heard(self, [self._told], 0), lambda: self.create_timer(PERIOD, self._tell))

    def _move(self, stow: Bool) -> None:
        def done() -> None:
            moving.cancel()
            self._stowed = stow.data

        moving = self.create_timer(REACHING, done)

    def _tell(self) -> None:
        self._told.publish(Bool(data=self._stowed))


def main() -> None:
    """Run the node."""
    run(Arm)


if __name__ == "__main__":
    main()
