"""What the oracle costs on ROS 1: a filtered topic and proxied services, beside the direct ones and a bare chain.

    source .build/ros1/setup.sh && python benchmarks/ros1.py [--rounds 2] [--seconds 2] [--json]

The bare chain has the same hops and no logic: rospy in, a WebSocket echo in another process, rospy out; its link has a
thread of its own, as the adapter's has. Everything runs in processes of its own, on this machine, one path after the
other, round by round. Latency is from before a message is published, or a service called, until it is there.
"""

from __future__ import annotations

import json
import threading
import time
from typing import Any

import rospy
from chains.parts import DEPTH, PATIENCE, BareLink, echo, hear_times, say, send_times, time_calls
from chains.run import Ros, free_port, main
from std_msgs.msg import Int64
from std_srvs.srv import SetBool, SetBoolResponse


def publisher(topic: str) -> rospy.Publisher:
    return rospy.Publisher(topic, Int64, queue_size=DEPTH, tcp_nodelay=True)


def start(name: str) -> None:
    rospy.init_node(name, disable_signals=True)


def send(rate: int, seconds: float) -> None:
    """The node that publishes."""
    start("sender")
    send_times(rate, seconds, publisher("/number").publish)


def receive(topic: str, wanted: int) -> None:
    """The node that hears."""
    start("receiver")
    hear_times(wanted, lambda hear: rospy.Subscriber(topic, Int64, hear, tcp_nodelay=True), lambda: time.sleep(0.1))


def serve() -> None:
    """The service itself."""
    start("server")
    rospy.Service("/switch", SetBool, lambda _request: SetBoolResponse())
    say("ready")
    rospy.spin()


def call(service: str) -> None:
    """The service's client."""
    start("caller")
    rospy.wait_for_service(service, PATIENCE)
    proxy = rospy.ServiceProxy(service, SetBool)
    time_calls(lambda: proxy(True))


def bare(port: int) -> None:
    """The chain without logic, for the topic and the service."""
    start("bare")
    link = BareLink(port)
    numbers = publisher("/number_mon")
    rospy.Subscriber(
        "/number",
        Int64,
        lambda message: link.ask(json.dumps({"data": message.data}), lambda: numbers.publish(message)),
        tcp_nodelay=True,
    )

    def passes(data: dict[str, Any]) -> None:
        settled = threading.Event()
        link.ask(json.dumps(data), settled.set)
        settled.wait()

    def pass_on(request: Any) -> Any:
        passes({"data": request.data})
        response = rospy.ServiceProxy("/switch", SetBool)(request)
        passes({"success": response.success, "message": response.message})
        return response

    rospy.Service("/switch_mon", SetBool, pass_on)
    say("ready")
    rospy.spin()


def described() -> Ros:
    port = free_port()
    return Ros(
        script=__file__,
        adapter="oracle_ros1",
        parts={
            "send": lambda rate, seconds: send(int(rate), float(seconds)),
            "receive": lambda topic, wanted: receive(topic, int(wanted)),
            "serve": serve,
            "call": call,
            "echo": echo,
            "bare": lambda port: bare(int(port)),
        },
        settings={"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"},
        core=("roscore", "-p", str(port)),
    )


if __name__ == "__main__":
    main(described(), __doc__)
