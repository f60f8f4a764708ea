"""The base: serves /navigate_to_pose, one goal at a time, and tells on /battery_state how it is charged.

    python3 -m navigation.base --ros-args -p fault:=false_success -p wait_for:=0

It waits for `wait_for` subscriptions to what it tells, one a monitor and one the mission, before it begins.
"""

from typing import Any

from navigation_msgs.action import NavigateToPose
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import BatteryState

from .logic import CHARGED, LOW, NONE, PERIOD, Drive, legs
from .node import DEPTH, fault_of, heard, run, when


class Base(Node):
    """Drives to where the goal under way says."""

    def __init__(self) -> None:
        super().__init__("base")
        self._fault = fault_of(self)
        self._drive = Drive(self._fault)
        self._left = sum(not leg.low for leg in legs(self._fault))  # goals until the battery is low
        self._under_way: tuple[Any, Future] | None = None  # a goal, and its error code once it is over
        self._battery = self.create_publisher(BatteryState, "battery_state", DEPTH)
        when(self, heard(self, [self._battery], 0), self._begin)

    def _begin(self) -> None:
        self._server = ActionServer(
            self,
            NavigateToPose,
            "navigate_to_pose",
            execute_callback=self._go,
            goal_callback=lambda _: GoalResponse.REJECT if self._under_way else GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self.get_logger().info("serving navigate_to_pose")
        self.create_timer(PERIOD, self._turn)

    async def _go(self, goal: Any) -> NavigateToPose.Result:
        over = Future()
        self._under_way = goal, over
        code = await over
        self._under_way = None
        self._left -= 1
        if code is None:
            goal.canceled()
        elif code == NONE:
            goal.succeed()
        else:
            goal.abort()
        return NavigateToPose.Result(error_code=code or NONE)

    def _turn(self) -> None:
        low = self._fault == "battery_low" and self._left <= 0
        self._battery.publish(BatteryState(percentage=LOW if low else CHARGED))
        if self._under_way is None:
            return
        goal, over = self._under_way
        if over.done():
            return
        if goal.is_cancel_requested:
            over.set_result(None)
            return
        place = goal.request.pose.pose.position
        code = self._drive.step(place.x, place.y)
        left = self._drive.distance(place.x, place.y)
        goal.publish_feedback(NavigateToPose.Feedback(distance_remaining=left))
        if code is not None:
            over.set_result(code)


def main() -> None:
    """Run the node."""
    run(Base)


if __name__ == "__main__":
    main()
