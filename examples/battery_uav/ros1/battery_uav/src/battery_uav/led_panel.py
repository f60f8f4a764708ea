"""The LED panel: shows the light of a status on request, and tells 35 times a second which is on.

    python3 -m battery_uav.led_panel _rate:=35.0 _fault:=silent_panel _wait_for:=0

It waits for `wait_for` subscriptions to each of its topics, one a monitor, before it offers /SetLED.
"""

import threading

import rospy
from battery_uav_msgs.msg import LedPanel, StatusAccepted
from battery_uav_msgs.srv import SetLED, SetLEDResponse

from .logic import Lights
from .node import fault, header, publisher, run, wait_heard


class Panel:
    """Serves /SetLED; rospy gives each call a thread of its own, so that one without an answer holds up nothing."""

    def __init__(self) -> None:
        self._lights = Lights(fault())
        self._changing = threading.Lock()
        self._rate = rospy.Rate(float(rospy.get_param("~rate", 35.0)))
        self._accepted = publisher("status_accepted", StatusAccepted)
        self._shown = publisher("LED_panel", LedPanel)

    def run(self) -> None:
        """Tell which light is on until the node ends."""
        wait_heard([self._accepted, self._shown], 0)
        self._tell()
        rospy.Service("SetLED", SetLED, self._set_led)
        rospy.loginfo("serving SetLED")
        while not rospy.is_shutdown():
            self._rate.sleep()
            self._tell()

    def _set_led(self, request: SetLED._request_class) -> SetLEDResponse:
        if self._lights.ignores():
            rospy.logwarn(f"ignoring the request for id {request.id}")
            rospy.spin()
        with self._changing:
            success = self._lights.show(request.id, request.status)
            if success:
                self._accepted.publish(StatusAccepted(header=header(), id=request.id))
        return SetLEDResponse(success=success, id=request.id)

    def _tell(self) -> None:
        with self._changing:
            self._shown.publish(LedPanel(header=header(), id=self._lights.cause, light=self._lights.light))


def main() -> None:
    """Run the node."""
    run("led_panel", lambda: Panel().run())


if __name__ == "__main__":
    main()
