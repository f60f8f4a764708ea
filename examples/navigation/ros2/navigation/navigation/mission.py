"""The mission: sends the base from goal to goal, lets the arm reach out where it is, and tells what came of it.

    python3 -m navigation.mission --ros-args -p action:=navigate_to_pose_mon -p fault:=arm_out

It ends with its last goal.
"""

from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatus
from navigation_msgs.action import NavigateToPose
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Bool

from .logic import CHARGED, Heard, Leg, legs
from .node import DEPTH, fault_of, run

ENDS = {GoalStatus.STATUS_SUCCEEDED: "succeeded", GoalStatus.STATUS_CANCELED: "canceled"}


class Mission(Node):
    """Sends one goal after the other, and ends."""

    def __init__(self) -> None:
        super().__init__("mission")
        self._legs = legs(fault_of(self))
        self._stowed, self._low = Heard(), Heard()
        action = str(self.declare_parameter("action", "navigate_to_pose_mon").value)
        self._client = ActionClient(self, NavigateToPose, action)
        self._stow = self.create_publisher(Bool, "arm/stow", DEPTH)
        self.create_subscription(Bool, "arm/stowed", self._hear_arm, DEPTH)
        self.create_subscription(BatteryState, "battery_state", self._hear_battery, DEPTH)
        self._first = self.create_timer(0.02, self._begin)

    def _begin(self) -> None:
        self._first.cancel()
        self.executor.create_task(self._run)

    async def _run(self) -> None:
        await self._until(self._client.server_is_ready)
        await self._until(lambda: self._stow.get_subscription_count() > 0)
        for leg in self._legs:
            await self._arm(stowed=not leg.arm_out)
            await self._until(lambda leg=leg: self._low.is_known(leg.low))
            end = await self._go(leg)
            self.get_logger().info(f"{leg.name}: {end}")
            if end == "succeeded":
                await self._arm(stowed=False)
        raise SystemExit

    async def _go(self, leg: Leg) -> str:
        goal = NavigateToPose.Goal()
        goal.pose.pose.position.x, goal.pose.pose.position.y = leg.x, leg.y
        near = Future()

        def hear(feedback: Any) -> None:
            if feedback.feedback.distance_remaining < leg.cancel_below and not near.done():
                near.set_result(None)

        handle = await self._client.send_goal_async(goal, feedback_callback=hear)
        if not handle.accepted:
            return "rejected"
        if leg.cancel_below:
            await near
            await handle.cancel_goal_async()
        result = await handle.get_result_async()
        return ENDS.get(result.status, f"aborted, error code {result.result.error_code}")

    async def _arm(self, *, stowed: bool) -> None:
        if not self._stowed.is_said(stowed):
            self._stow.publish(Bool(data=stowed))
        await self._until(lambda: self._stowed.is_known(stowed))

    async def _until(self, condition: Callable[[], object]) -> None:
        met = Future()

        def look() -> None:
            if condition() and not met.done():
                met.set_result(None)

        timer = self.create_timer(0.02, look)
        await met
        self.destroy_timer(timer)

    def _hear_arm(self, stowed: Bool) -> None:
        self._stowed.hear(stowed.data)

    def _hear_battery(self, battery: BatteryState) -> None:
        self._low.hear(battery.percentage < CHARGED / 2)


def main() -> None:
    """Run the node."""
    run(Mission)


if __name__ == "__main__":
    main()
