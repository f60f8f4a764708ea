"""What the oracle costs on ROS 2: a filtered topic and proxied services, beside the direct ones and a bare chain.

    source .build/ros2/setup.sh && python benchmarks/ros2.py [--rounds 2] [--json]

The bare chain has the same hops and no logic: rclpy in, a WebSocket echo in another process, rclpy out; its link has a
thread of its own, as the adapter's has. Everything runs in processes of its own, on this machine, one path after the
other, round by round. Latency is from before a message is published, or a service called, until it is there.
"""

from __future__ import annotations

import importlib
import json
import os
from typing import Any

from chains.parts import DEPTH, PATIENCE, BareLink, echo, hear_times, say, send_times, time_calls
from chains.run import Ros, main


def node_of(name: str) -> tuple[Any, Any]:
    """A node and its executor."""
    rclpy = importlib.import_module("rclpy")
    rclpy.init()
    node = rclpy.create_node(name)
    executor = importlib.import_module("rclpy.executors").SingleThreadedExecutor()
    executor.add_node(node)
    return node, executor


def number_type() -> Any:
    return importlib.import_module("std_msgs.msg").Int64


def switch_type() -> Any:
    return importlib.import_module("std_srvs.srv").SetBool


def send(rate: int, seconds: float) -> None:
    """The node that publishes."""
    node, _ = node_of("sender")
    publisher = node.create_publisher(number_type(), "/number", DEPTH)
    send_times(rate, seconds, lambda number: publisher.publish(number_type()(data=number)))


def receive(topic: str, wanted: int) -> None:
    """The node that hears."""
    node, executor = node_of("receiver")
    hear_times(
        wanted,
        lambda hear: node.create_subscription(number_type(), topic, hear, DEPTH),
        lambda: executor.spin_once(timeout_sec=0.1),
    )


def serve() -> None:
    """The service itself."""
    node, executor = node_of("server")
    node.create_service(switch_type(), "/switch", lambda _request, response: response)
    say("ready")
    spin(executor)


def call(service: str) -> None:
    """The service's client."""
    node, executor = node_of("caller")
    client = node.create_client(switch_type(), service)
    assert client.wait_for_service(PATIENCE)

    def once() -> None:
        answer = client.call_async(switch_type().Request(data=True))
        executor.spin_until_future_complete(answer, PATIENCE)
        assert answer.done()

    time_calls(once)


def bare(port: int) -> None:
    """The chain without logic, for the topic and the service."""
    node, executor = node_of("bare")
    link = BareLink(port)
    publisher = node.create_publisher(number_type(), "/number_mon", DEPTH)

    def take(message: Any) -> None:
        link.ask(json.dumps({"data": message.data}), lambda: publisher.publish(message))

    node.create_subscription(number_type(), "/number", take, DEPTH)
    group = importlib.import_module("rclpy.callback_groups").ReentrantCallbackGroup()
    client = node.create_client(switch_type(), "/switch", callback_group=group)
    future = importlib.import_module("rclpy.task").Future

    async def passes(data: dict[str, Any]) -> None:
        settled = future(executor=executor)

        def settle() -> None:
            settled.set_result(None)
            executor.wake()

        link.ask(json.dumps(data), settle)
        await settled

    async def pass_on(request: Any, _response: Any) -> Any:
        await passes({"data": request.data})
        while not client.service_is_ready():  # at first
            await passes({})
        response = await client.call_async(request)
        await passes({"success": response.success, "message": response.message})
        return response

    node.create_service(switch_type(), "/switch_mon", pass_on, callback_group=group)
    say("ready")
    spin(executor)


def spin(executor: Any) -> None:
    while True:
        executor.spin_once(timeout_sec=0.1)


ROS2 = Ros(
    script=__file__,
    adapter="oracle_ros2",
    parts={
        "send": lambda rate, seconds: send(int(rate), float(seconds)),
        "receive": lambda topic, wanted: receive(topic, int(wanted)),
        "serve": serve,
        "call": call,
        "echo": echo,
        "bare": lambda port: bare(int(port)),
    },
    settings={"ROS_DOMAIN_ID": str(os.getpid() % 80 + 20), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
)

if __name__ == "__main__":
    main(ROS2, __doc__)
