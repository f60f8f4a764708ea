"""The base: serves /navigate_to_pose, one goal at a time, and tells on /battery_state how it is charged.

    python3 -m navigation.base _fault:=false_success _wait_for:=0

It waits for `wait_for` subscriptions to what it tells, one a monitor and one the mission, before it begins.
"""

import actionlib
import rospy
from navigation_msgs.msg import NavigateToPoseAction, NavigateToPoseFeedback, NavigateToPoseGoal, NavigateToPoseResult
from sensor_msgs.msg import BatteryState

from .logic import CHARGED, LOW, NONE, PERIOD, Drive, legs
from .node import fault, publisher, run, wait_heard


class Base:
    """Drives to where the goal under way says."""

    def __init__(self) -> None:
        self._fault = fault()
        self._drive = Drive(self._fault)
        self._left = sum(not leg.low for leg in legs(self._fault))  # goals until the battery is low
        self._battery = publisher("battery_state", BatteryState)

    def run(self) -> None:
        """Tell how it is charged until the node ends."""
        wait_heard(self._battery)
        self._server = actionlib.SimpleActionServer(
            "navigate_to_pose", NavigateToPoseAction, self._go, auto_start=False
        )
        self._server.start()
        rospy.on_shutdown(self._still)
        rospy.loginfo("serving navigate_to_pose")
        while not rospy.is_shutdown():
            low = self._fault == "battery_low" and self._left <= 0
            self._battery.publish(BatteryState(percentage=LOW if low else CHARGED))
            rospy.sleep(PERIOD)

    def _still(self) -> None:
        """Let actionlib tell no more status: else it may while the node closes its topics, and end with a traceback."""
        timer = self._server.action_server.status_timer
        timer.shutdown()
        timer.join(1.0)

    def _go(self, goal: NavigateToPoseGoal) -> None:
        place = goal.pose.pose.position
        code = None
        while code is None and not self._server.is_preempt_requested() and not rospy.is_shutdown():
            code = self._drive.step(place.x, place.y)
            left = self._drive.distance(place.x, place.y)
            self._server.publish_feedback(NavigateToPoseFeedback(distance_remaining=left))
            rospy.rostime.wallsleep(PERIOD)
        self._left -= 1
        if code is None:
            self._server.set_preempted()
        elif code == NONE:
            self._server.set_succeeded(NavigateToPoseResult(error_code=NONE))
        else:
            self._server.set_aborted(NavigateToPoseResult(error_code=code))


def main() -> None:
    """Run the node."""
    run("base", lambda: Base().run())


if __name__ == "__main__":
    main()
