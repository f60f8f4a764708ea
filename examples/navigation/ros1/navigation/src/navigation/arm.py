"""The arm on the base: it reaches out and is stowed as /arm/stow says, and tells on /arm/stowed whether it is.

    python3 -m navigation.arm _wait_for:=0

It waits for `wait_for` subscriptions to what it tells, one a monitor and one the mission, before it begins.
"""

import rospy
from std_msgs.msg import Bool

from .logic import PERIOD, REACHING
from .node import publisher, run, wait_heard


class Arm:
    """Stowed to begin with."""

    def __init__(self) -> None:
        self._stowed = True
        self._told = publisher("arm/stowed", Bool)

    def run(self) -> None:
        """Tell whether it is stowed until the node ends."""
        rospy.Subscriber("arm/stow", Bool, self._move)
        wait_heard(self._told)
        while not rospy.is_shutdown():
            self._told.publish(Bool(data=self._stowed))
            rospy.sleep(PERIOD)

    def _move(self, stow: Bool) -> None:
        rospy.sleep(REACHING)
        self._stowed = stow.data


def main() -> None:
    """Run the node."""
    run("arm", lambda: Arm().run())


if __name__ == "__main__":
    main()
