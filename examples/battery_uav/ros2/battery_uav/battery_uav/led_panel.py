"""The LED panel: shows the light of a status on request, and tells 35 times a second which is on.

    python3 -m battery_uav.led_panel --ros-args -p rate:=35.0 -p fault:=silent_panel -p wait_for:=0

It waits for `wait_for` subscriptions to each of its topics, one a monitor, before it offers /SetLED.
"""

from battery_uav_msgs import msg
from battery_uav_msgs.srv import SetLED
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future

from .node import DEPTH, fault_of, header, heard, run, when

LIGHTS = ("off", "green", "yellow", "red")  # by status
IGNORED_CALL = 2  # by a silent panel, counted from 1: the one for a warning


class Panel(Node):
    """Serves /SetLED."""

    def __init__(self) -> None:
        super().__init__("led_panel")
        self._period = 1 / self.declare_parameter("rate", 35.0).value
        self._silent = fault_of(self) == "silent_panel"
        self._calls = 0
        self._shown = (0, 0)  # id and status
        self._accepted = self.create_publisher(msg.StatusAccepted, "status_accepted", DEPTH)
        self._lights = self.create_publisher(msg.LedPanel, "LED_panel", DEPTH)
        when(self, heard(self, [self._accepted, self._lights], 0), self._begin)

    def _begin(self) -> None:
        self._tell()
        # In a group of its own, a request that is never answered holds up nothing else.
        self.create_service(SetLED, "SetLED", self._set_led, callback_group=ReentrantCallbackGroup())
        self.create_timer(self._period, self._tell)

    async def _set_led(self, request: SetLED.Request, response: SetLED.Response) -> SetLED.Response:
        self._calls += 1
        if self._silent and self._calls == IGNORED_CALL:
            self.get_logger().warning(f"ignoring the request for id {request.id}")
            await Future()  # which nobody ever completes
        response.id = request.id
        response.success = request.status < len(LIGHTS)
        if response.success:
            self._shown = (request.id, request.status)
            self._accepted.publish(msg.StatusAccepted(header=header(self), id=request.id))
        return response

    def _tell(self) -> None:
        cause, status = self._shown
        self._lights.publish(msg.LedPanel(header=header(self), id=cause, light=LIGHTS[status]))


def main() -> None:
    """Run the node."""
    run(Panel)


if __name__ == "__main__":
    main()
