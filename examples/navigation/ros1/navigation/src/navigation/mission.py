"""The mission: sends the base from goal to goal, lets the arm reach out where it is, and tells what came of it.

    python3 -m navigation.mission _action:=navigate_to_pose_mon _fault:=arm_out

It ends with its last goal.
"""

import threading

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus
from navigation_msgs.msg import NavigateToPoseAction, NavigateToPoseFeedback, NavigateToPoseGoal
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Bool

from .logic import CHARGED, Heard, Leg, legs
from .node import fault, publisher, run, until

ENDS = {GoalStatus.SUCCEEDED: "succeeded", GoalStatus.PREEMPTED: "canceled", GoalStatus.REJECTED: "rejected"}


class Mission:
    """Sends one goal after the other."""

    def __init__(self) -> None:
        self._stowed, self._low = Heard(), Heard()
        action = str(rospy.get_param("~action", "navigate_to_pose_mon"))
        self._client = actionlib.SimpleActionClient(action, NavigateToPoseAction)
        self._stow = publisher("arm/stow", Bool)
        rospy.Subscriber("arm/stowed", Bool, self._hear_arm)
        rospy.Subscriber("battery_state", BatteryState, self._hear_battery)

    def run(self) -> None:
        """Send all goals."""
        self._client.wait_for_server()
        until(self._stow.get_num_connections)
        for leg in legs(fault()):
            self._arm(stowed=not leg.arm_out)
            until(lambda leg=leg: self._low.is_known(leg.low))
            end = self._go(leg)
            rospy.loginfo(f"{leg.name}: {end}")
            if end == "succeeded":
                self._arm(stowed=False)

    def _go(self, leg: Leg) -> str:
        goal = NavigateToPoseGoal()
        goal.pose.pose.position.x, goal.pose.pose.position.y = leg.x, leg.y
        near = threading.Event()

        def hear(feedback: NavigateToPoseFeedback) -> None:
            if feedback.distance_remaining < leg.cancel_below:
                near.set()

        self._client.send_goal(goal, feedback_cb=hear)
        until(lambda: near.is_set() or self._client.wait_for_result(rospy.Duration(0.02)))
        if near.is_set():
            self._client.cancel_goal()
            until(lambda: self._client.wait_for_result(rospy.Duration(0.02)))
        state, text = self._client.get_state(), self._client.get_goal_status_text()
        end = ENDS.get(state, f"aborted, error code {self._client.get_result().error_code}")
        return f"{end}, {text}" if text else end

    def _arm(self, *, stowed: bool) -> None:
        if not self._stowed.is_said(stowed):
            self._stow.publish(Bool(data=stowed))
        until(lambda: self._stowed.is_known(stowed))

    def _hear_arm(self, stowed: Bool) -> None:
        self._stowed.hear(stowed.data)

    def _hear_battery(self, battery: BatteryState) -> None:
        self._low.hear(battery.percentage < CHARGED / 2)


def main() -> None:
    """Run the node."""
    run("mission", lambda: Mission().run())


if __name__ == "__main__":
    main()
