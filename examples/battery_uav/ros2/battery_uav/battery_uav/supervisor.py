"""The supervisor: reports the battery's status ten times a second and, on a change, calls for another light.

    python3 -m battery_uav.supervisor --ros-args -p service:=/SetLED -p fault:=wrong_status

It calls `service`, by default the monitor's proxy /SetLED_mon, when it hears its own /status_change. With
`call_inside_callback` it calls inside the round that found the change, and neither reports nor hears percentages
until the answer is there: a monitor that holds the request back until the supervisor's next report waits for ever.

It takes percentages once the service is there and each of its topics has `wait_for` subscriptions, one a monitor.
"""

from time import monotonic

from battery_uav_msgs.msg import BatteryPercentage, BatteryStatus, InputAccepted, StatusChange
from battery_uav_msgs.srv import SetLED
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from rclpy.timer import Timer

from .logic import OFFSET, Report, Supervision
from .node import DEPTH, fault_of, header, heard, run, when


class Supervisor(Node):
    """Hears the battery, and calls the LED panel."""

    def __init__(self) -> None:
        super().__init__("battery_supervisor")
        self._period = 1 / self.declare_parameter("rate", 10.0).value
        self._inside: bool = self.declare_parameter("call_inside_callback", False).value
        self._supervision = Supervision(fault_of(self))
        self._newest: BatteryPercentage | None = None
        self._timer: Timer | None = None
        self._inputs = self.create_publisher(InputAccepted, "input_accepted", DEPTH)
        self._statuses = self.create_publisher(BatteryStatus, "battery_status", DEPTH)
        self._changes = self.create_publisher(StatusChange, "status_change", DEPTH)
        self.create_subscription(StatusChange, "status_change", self._hear_change, DEPTH)
        service: str = self.declare_parameter("service", "SetLED_mon").value
        # In a group of its own, the answer gets through while a round waits for it.
        self._panel = self.create_client(SetLED, service, callback_group=ReentrantCallbackGroup())
        self.get_logger().info(f"waiting for the service {self._panel.srv_name}")
        monitored = heard(self, [self._inputs, self._statuses], 0)
        when(self, lambda: self._panel.service_is_ready() and monitored(), self._begin)

    def _begin(self) -> None:
        self.create_subscription(BatteryPercentage, "battery_percentage", self._hear_percentage, DEPTH)

    def _hear_percentage(self, percentage: BatteryPercentage) -> None:
        self._newest = percentage
        if self._timer is None:
            self._timer = self.create_timer(OFFSET * self._period, self._first_round)

    async def _first_round(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.create_timer(self._period, self._round)
        await self._round()

    async def _round(self) -> None:
        """Report the status of the newest percentage, if there is one that was not reported yet."""
        percentage, self._newest = self._newest, None
        if percentage is None:
            return
        reports, calls = self._supervision.round(percentage.id, percentage.percentage)
        self._inputs.publish(InputAccepted(header=header(self), id=percentage.id))
        for report in reports:
            self._report(report)
        if calls:
            status = reports[0].status
            if self._inside:
                await self._set_led(percentage.id, status)
            else:
                self._changes.publish(StatusChange(header=header(self), id=percentage.id, status=status))

    def _report(self, report: Report) -> None:
        cause, status, change = report
        self._statuses.publish(BatteryStatus(header=header(self), id=cause, status=status, status_change=change))

    def _hear_change(self, change: StatusChange) -> None:
        self._set_led(change.id, change.status)

    def _set_led(self, cause: int, status: int) -> Future:
        """Call the panel; the caller may wait for the answer, or not."""
        called = monotonic()

        def tell(answer: Future) -> None:
            outcome = "done" if answer.result().success else "denied"
            self.get_logger().info(f"light for id {cause}: {outcome} after {(monotonic() - called) * 1000:.1f} ms")

        answer = self._panel.call_async(SetLED.Request(id=cause, status=status))
        answer.add_done_callback(tell)
        return answer


def main() -> None:
    """Run the node."""
    run(Supervisor)


if __name__ == "__main__":
    main()
