"""The supervisor: reports the battery's status ten times a second and, on a change, calls for another light.

    python3 -m battery_uav.supervisor _service:=/SetLED _fault:=wrong_status

It calls `service`, by default the monitor's proxy /SetLED_mon, when it hears its own /status_change. With
`call_inside_callback` it calls inside the round that found the change, and does not report until the answer is there.

It takes percentages once the service is there and each of its topics has `wait_for` subscriptions, one a monitor.
"""

from time import monotonic
from typing import Optional

import rospy
import rosservice
from battery_uav_msgs.msg import BatteryPercentage, BatteryStatus, InputAccepted, StatusChange
from battery_uav_msgs.srv import SetLED

from .logic import OFFSET, Supervision
from .node import fault, header, publisher, run, wait_heard


class Supervisor:
    """Hears the battery, and calls the LED panel."""

    def __init__(self) -> None:
        self._hertz = float(rospy.get_param("~rate", 10.0))
        self._inside = bool(rospy.get_param("~call_inside_callback", False))
        self._service = rospy.resolve_name(rospy.get_param("~service", "SetLED_mon"))
        self._supervision = Supervision(fault())
        self._newest: Optional[BatteryPercentage] = None
        self._inputs = publisher("input_accepted", InputAccepted)
        self._statuses = publisher("battery_status", BatteryStatus)
        self._changes = publisher("status_change", StatusChange)
        rospy.Subscriber("status_change", StatusChange, lambda change: self._set_led(change.id, change.status))

    def run(self) -> None:
        """Report until the node ends."""
        rospy.loginfo(f"waiting for the service {self._service}")
        wait_heard([self._inputs, self._statuses], 0, self._ready)
        rospy.Subscriber("battery_percentage", BatteryPercentage, self._hear_percentage, tcp_nodelay=True)
        while self._newest is None:
            rospy.rostime.wallsleep(0.001)
            if rospy.is_shutdown():
                return
        rospy.sleep(OFFSET / self._hertz)
        rate = rospy.Rate(self._hertz)
        while not rospy.is_shutdown():
            self._round()
            rate.sleep()

    def _ready(self) -> bool:
        """Whether it can call, and hears itself."""
        return self._changes.get_num_connections() > 0 and rosservice.get_service_uri(self._service) is not None

    def _hear_percentage(self, percentage: BatteryPercentage) -> None:
        self._newest = percentage

    def _round(self) -> None:
        """Report the status of the newest percentage, if there is one that was not reported yet."""
        taken, self._newest = self._newest, None
        if taken is None:
            return
        reports, calls = self._supervision.round(taken.id, taken.percentage)
        self._inputs.publish(InputAccepted(header=header(), id=taken.id))
        for cause, status, change in reports:
            self._statuses.publish(BatteryStatus(header=header(), id=cause, status=status, status_change=change))
        if calls and self._inside:
            self._set_led(taken.id, reports[0].status)
        elif calls:
            self._changes.publish(StatusChange(header=header(), id=taken.id, status=reports[0].status))

    def _set_led(self, cause: int, status: int) -> None:
        called = monotonic()
        try:
            answer = rospy.ServiceProxy(self._service, SetLED)(id=cause, status=status)
        except rospy.ServiceException as error:
            rospy.logwarn(f"light for id {cause}: denied: {error}")
        else:
            outcome = "done" if answer.success else "denied"
            rospy.loginfo(f"light for id {cause}: {outcome} after {(monotonic() - called) * 1000:.1f} ms")


def main() -> None:
    """Run the node."""
    run("battery_supervisor", lambda: Supervisor().run())


if __name__ == "__main__":
    main()
