"""The LED panel: shows the light of a status on request, and tells 35 times a second which is on.

    python3 -m battery_uav.led_panel --ros-args -p rate:=35.0 -p fault:=silent_panel -p wait_for:=0

It waits for `wait_for` subscriptions to each of its topics, one a monitor, before it offers /SetLED.
"""

from battery_uav_msgs import msg
from battery_uav_msgs.srv import SetLED
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from .logic import Lights
from .node import DEPTH, fault_of, header, heard, run, when


class Panel(Node):
    """Serves /SetLED."""

    def __init__(self) -> None:
        super().__init__("led_panel")
        self._period = 1 / self.declare_parameter("rate", 35.0).value
        self._lights_on = Lights(fault_of(self))
        self._accepted = self.create_publisher(msg.StatusAccepted, "status_accepted", DEPTH)
        self._lights = self.create_publisher(msg.LedPanel, "LED_panel", DEPTH)
        when(self, heard(self, [self._accepted, self._lights], 0), self._begin)

    def _begin(self) -> None:
        self._tell()
        # In a group of its own, a request that is never answered holds up nothing else.
        self.create_service(SetLED, "SetLED", self._set_led, callback_group=ReentrantCallbackGroup())
        self.get_logger().info("serving SetLED")
        self.create_timer(self._period, self._tell)

    async def _set_led(self, request: SetLED.Request, response: SetLED.Response) -> SetLED.Response:
        if self._lights_on.ignores():
            self.get_logger().warning(f"ignoring the request for id {request.id}")
            await Future()  # which nobody ever completes
        response.id = request.id
        response.success = self._lights_on.show(request.id, request.status)
        if response.success:
            self._accepted.publish(msg.StatusAccepted(header=header(self), id=request.id))
        return response

    def _tell(self) -> None:
        shown = self._lights_on
        self._lights.publish(msg.LedPanel(header=header(self), id=shown.cause, light=shown.light))


def main() -> None:
    """Run the node."""
    run(Panel)


if __name__ == "__main__":
    main()
