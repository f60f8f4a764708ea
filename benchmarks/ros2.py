"""What the oracle costs on ROS 2: topics, services and an action, beside the direct ones and a bare chain.

    source .build/ros2/setup.sh && python benchmarks/ros2.py [--rounds 2] [--no-topics | --topics-alone] [--json]

The bare chain has the same hops and no logic: rclpy in, a WebSocket echo in another process, rclpy out; its link has a
thread of its own, as the adapter's has. Embedded, the adapter judges by itself: left out where the server has another
Python. Everything runs in processes of its own, on this machine, one path after the other, round by round. Latency is
from before a message is published, or a service called, until it is there.
"""

from __future__ import annotations

import importlib
import json
import os
import threading
import time
from typing import Any

from chains.parts import DEPTH, GOALS, PATIENCE, BareLink, echo, hear_times, say, send_times, time_calls, wait
from chains.run import FEW, PAUSE, Ros, main

SUCCEEDED = 4
LATER = 1000
"""The order of a goal that begins some time after its reply: the others begin while that is on its way."""


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


def call(service: str, pause: float) -> None:
    """The service's client."""
    node, executor = node_of("caller")
    client = node.create_client(switch_type(), service)
    assert client.wait_for_service(PATIENCE)

    def once() -> None:
        answer = client.call_async(switch_type().Request(data=True))
        executor.spin_until_future_complete(answer, PATIENCE)
        assert answer.done()

    time_calls(once, pause)


def fibonacci_type() -> Any:
    return importlib.import_module("test_msgs.action").Fibonacci


def perform(kept: int) -> None:
    """The action's server: its goals end at once, or tell the time as feedback, at 100 Hz."""
    node, executor = node_of("performer")
    action, kind = importlib.import_module("rclpy.action"), fibonacci_type()
    threads = importlib.import_module("rclpy.executors").MultiThreadedExecutor(3)
    executor.remove_node(node)
    threads.add_node(node)

    def begin(handle: Any) -> None:
        if handle.request.order == LATER:
            threading.Timer(0.03, handle.execute).start()
        else:
            handle.execute()

    def execute(handle: Any) -> Any:
        for _ in range(handle.request.order % LATER):
            handle.publish_feedback(kind.Feedback(sequence=divmod(time.monotonic_ns(), 2**31)))
            time.sleep(0.01)
        handle.succeed()
        return kind.Result()

    expiry = PAUSE if kept == FEW else 900
    server = action.ActionServer(node, kind, "/fib", execute, handle_accepted_callback=begin, result_timeout=expiry)
    say("ready")
    while server:
        threads.spin_once(timeout_sec=0.1)


def act(name: str, kept: int) -> None:
    """The action's client: it tells the latencies (ms) of replies, of results, and of feedback."""
    node, executor = node_of("actor")
    kind = fibonacci_type()
    client = importlib.import_module("rclpy.action").ActionClient(node, kind, name)
    feedback: list[float] = []

    def hear(message: Any) -> None:
        high, low = message.feedback.sequence
        feedback.append((time.monotonic_ns() - (high * 2**31 + low)) / 1e6)

    def done(future: Any) -> Any:
        executor.spin_until_future_complete(future, PATIENCE)
        return future.result()

    def rest() -> None:
        """Take what still comes of the last goal: of 200 kept an array is read for 5 ms, and no reply meanwhile."""
        end = time.monotonic() + PAUSE
        while (left := end - time.monotonic()) > 0:
            executor.spin_once(timeout_sec=left)

    def run(order: int) -> tuple[float, float]:
        began = time.monotonic_ns()
        goal = done(client.send_goal_async(kind.Goal(order=order), hear))
        replied = time.monotonic_ns()
        assert goal.accepted
        if done(goal.get_result_async()).status != SUCCEEDED:
            return run(order)  # it was asked for too late, and had expired: the machine is busy
        return (replied - began) / 1e6, (time.monotonic_ns() - began) / 1e6

    def rested(order: int) -> tuple[float, float]:
        rest()
        return run(order)

    assert client.wait_for_server(PATIENCE)
    time.sleep(2)  # until a proxy has found the server
    for _ in range(max(20, kept)):
        run(0)
    times = [rested(0) for _ in range(GOALS)]
    later = [rested(LATER)[0] for _ in range(GOALS)]
    run(GOALS)
    wait(lambda: len(feedback) == GOALS or executor.spin_once(timeout_sec=0.1))
    say(json.dumps({"goal to reply": [t for t, _ in times], "reply to a goal begun later": later,
                    "goal to result": [t for _, t in times], "feedback at 100 Hz": feedback}))  # fmt: skip


def bare_action(node: Any, executor: Any, link: BareLink, group: Any) -> None:
    """The chain without logic, for the action: goals and replies go through the echo, of the rest it is told."""
    impl = fibonacci_type().Impl
    status = importlib.import_module("action_msgs.msg").GoalStatusArray
    cancel = importlib.import_module("action_msgs.srv").CancelGoal
    future = importlib.import_module("rclpy.task").Future
    keep = importlib.import_module("rclpy.qos").qos_profile_action_status_default

    async def passes() -> None:
        settled = future(executor=executor)

        def settle() -> None:
            settled.set_result(None)
            executor.wake()

        link.ask("{}", settle)
        await settled

    def serve(type_: Any, name: str, asked: bool) -> None:
        called = node.create_client(type_, f"/fib/_action/{name}", callback_group=group)

        async def pass_on(request: Any, _response: Any) -> Any:
            if asked:
                await passes()
            while not called.service_is_ready():  # at first
                await passes()
            response = await called.call_async(request)
            if asked:
                await passes()
            return response

        node.create_service(type_, f"/fib_mon/_action/{name}", pass_on, callback_group=group)

    def repeat(type_: Any, name: str, profile: Any) -> None:
        given = node.create_publisher(type_, f"/fib_mon/_action/{name}", profile)

        def take(message: bytes) -> None:
            given.publish(message)
            link.ask("{}", lambda: None)

        node.create_subscription(type_, f"/fib/_action/{name}", take, profile, raw=True)

    serve(impl.SendGoalService, "send_goal", asked=True)
    serve(impl.GetResultService, "get_result", asked=False)
    serve(cancel, "cancel_goal", asked=False)
    repeat(impl.FeedbackMessage, "feedback", 10)
    repeat(status, "status", keep)


def bare(port: int) -> None:
    """The chain without logic, for the topic, the service and the action."""
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
    bare_action(node, executor, link, group)
    say("ready")
    spin(executor)


def spin(executor: Any) -> None:
    while True:
        executor.spin_once(timeout_sec=0.1)


FIBONACCI = """
  - ros_action: /fib
    type: test_msgs/action/Fibonacci
    action: filter
    ask: [goal, reply]
    goal: {signals: {order: msg.order}}
    reply: {signals: {accepted: msg.accepted}}
    feedback: {signals: {length: size(msg.sequence)}}
    result: {signals: {length: size(msg.sequence)}}"""

ROS2 = Ros(
    script=__file__,
    adapter="oracle_ros2",
    parts={
        "send": lambda rate, seconds: send(int(rate), float(seconds)),
        "receive": lambda topic, wanted: receive(topic, int(wanted)),
        "serve": serve,
        "call": lambda service, pause: call(service, float(pause)),
        "perform": lambda kept: perform(int(kept)),
        "act": lambda name, kept: act(name, int(kept)),
        "echo": echo,
        "bare": lambda port: bare(int(port)),
    },
    action=FIBONACCI,
    settings={"ROS_DOMAIN_ID": str(os.getpid() % 18 + 215), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
)

if __name__ == "__main__":
    main(ROS2, __doc__)
