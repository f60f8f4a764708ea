"""The battery: counts down from 100 % to 0, and ends.

    python3 -m battery_uav.battery --ros-args -p rate:=25.0 -p countdowns:=1 -p wait_for:=1

It waits for `wait_for` subscriptions to /battery_percentage: the supervisor's, and one a monitor.
"""

from battery_uav_msgs.msg import BatteryPercentage
from rclpy.duration import Duration
from rclpy.node import Node

from .logic import COUNTDOWN, percentage
from .node import DEPTH, header, heard, run, when


class Battery(Node):
    """Publishes each percentage under an id of its own: 1, 2, 3…, without a gap."""

    def __init__(self) -> None:
        super().__init__("battery")
        self._period = 1 / self.declare_parameter("rate", 25.0).value
        self._last = COUNTDOWN * self.declare_parameter("countdowns", 1).value
        self._number = 0
        self._percentages = self.create_publisher(BatteryPercentage, "battery_percentage", DEPTH)
        when(self, heard(self, [self._percentages], 1), self._begin)

    def _begin(self) -> None:
        self._count()
        self.create_timer(self._period, self._count)

    def _count(self) -> None:
        if self._number == self._last:
            if self._percentages.wait_for_all_acked(Duration()):  # it asks, and does not wait
                raise SystemExit
            return
        self._number += 1
        percent = percentage(self._number)
        self._percentages.publish(BatteryPercentage(header=header(self), id=self._number, percentage=percent))


def main() -> None:
    """Run the node."""
    run(Battery)


if __name__ == "__main__":
    main()
