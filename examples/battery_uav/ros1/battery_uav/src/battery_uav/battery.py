"""The battery: counts down from 100 % to 0, and ends.

    python3 -m battery_uav.battery _rate:=25.0 _countdowns:=1 _wait_for:=1

It waits for `wait_for` subscriptions to /battery_percentage: the supervisor's, and one a monitor.
"""

import rospy
from battery_uav_msgs.msg import BatteryPercentage

from .logic import COUNTDOWN, percentage
from .node import header, publisher, run, wait_heard

LINGER = 1.0  # seconds in which the last messages leave: ROS 1 does not tell when they have


def count_down() -> None:
    """Publish each percentage under an id of its own: 1, 2, 3…, without a gap."""
    percentages = publisher("battery_percentage", BatteryPercentage)
    rate = rospy.Rate(float(rospy.get_param("~rate", 25.0)))
    wait_heard([percentages], 1)
    for number in range(1, COUNTDOWN * int(rospy.get_param("~countdowns", 1)) + 1):
        percentages.publish(BatteryPercentage(header=header(), id=number, percentage=percentage(number)))
        rate.sleep()
    rospy.sleep(LINGER)


def main() -> None:
    """Run the node."""
    run("battery", count_down)


if __name__ == "__main__":
    main()
