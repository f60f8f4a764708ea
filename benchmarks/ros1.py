"""What the oracle costs on ROS 1: topics, services and an action, beside the direct ones and a bare chain.

    source .build/ros1/setup.sh && python benchmarks/ros1.py [--rounds 2] [--no-topics | --topics-alone] [--json]

The bare chain has the same hops and no logic: rospy in, a WebSocket echo in another process, rospy out; its link has a
thread of its own, as the adapter's has. Embedded, the adapter judges by itself: left out where the server has another
Python. Everything runs in processes of its own, on this machine, one path after the other, round by round. Latency is
from before a message is published, or a service called, until it is there.
"""

from __future__ import annotations

import json
import threading
import time
from typing import Any

import actionlib
import rospy
from actionlib.msg import TestAction, TestActionFeedback, TestActionGoal, TestActionResult, TestFeedback, TestGoal
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from chains.parts import DEPTH, GOALS, PATIENCE, BareLink, echo, hear_times, say, send_times, time_calls
from chains.run import FEW, PAUSE, Ros, free_port, main
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


def call(service: str, pause: float) -> None:
    """The service's client."""
    start("caller")
    rospy.wait_for_service(service, PATIENCE)
    proxy = rospy.ServiceProxy(service, SetBool)
    time_calls(lambda: proxy(True), pause)


def microseconds() -> int:
    """The time as feedback can tell it."""
    return time.monotonic_ns() // 1000 % 2**31


def perform(kept: int) -> None:
    """The action's server: its goals end at once, or tell the time as feedback, at 100 Hz."""
    start("performer")
    rospy.set_param("/fib/status_list_timeout", PAUSE if kept == FEW else 900.0)

    def execute(handle: Any) -> None:
        handle.set_accepted()
        for _ in range(handle.get_goal().goal):
            handle.publish_feedback(TestFeedback(microseconds()))
            time.sleep(0.01)
        handle.set_succeeded()

    def take(handle: Any) -> None:
        if handle.get_goal().goal:
            threading.Thread(target=execute, args=[handle]).start()
        else:
            execute(handle)

    actionlib.ActionServer("/fib", TestAction, take, auto_start=False).start()
    say("ready")
    rospy.spin()


def act(name: str, kept: int) -> None:
    """The action's client: it tells the latencies (ms) of replies, of results, and of feedback."""
    start("actor")
    client = actionlib.ActionClient(name, TestAction)
    feedback: list[float] = []

    def hear(_handle: Any, message: Any) -> None:
        feedback.append((microseconds() - message.feedback) % 2**31 / 1000)

    def run(goal: int) -> tuple[float, float]:
        replied: list[int] = []
        ended = threading.Event()

        def changed(handle: Any) -> None:
            replied.append(time.monotonic_ns())
            if handle.get_comm_state() == actionlib.CommState.DONE:
                ended.set()

        began = time.monotonic_ns()
        sent = client.send_goal(TestGoal(goal), changed, hear)
        assert ended.wait(PATIENCE), f"a goal has not ended in {PATIENCE} s, its state is {sent.get_comm_state()}"
        assert sent.get_terminal_state() == GoalStatus.SUCCEEDED, sent.get_goal_status_text()
        return (replied[0] - began) / 1e6, (replied[-1] - began) / 1e6

    def rested(goal: int) -> tuple[float, float]:
        time.sleep(PAUSE)
        return run(goal)

    assert client.wait_for_server(rospy.Duration(PATIENCE)), f"{name} has no server"
    time.sleep(1)  # a connection counts here before its other end has it
    for _ in range(max(20, kept)):
        run(0)
    times = [rested(0) for _ in range(GOALS)]
    run(GOALS)
    time.sleep(1)  # the result may overtake feedback, which is then dropped
    say(json.dumps({"goal to reply": [t for t, _ in times], "goal to result": [t for _, t in times],
                    "feedback at 100 Hz": feedback}))  # fmt: skip


def bare_action(link: BareLink) -> None:
    """The chain without logic, for the action: goals go through the echo, of the rest it is told."""

    def repeat(kind: Any, name: str, asked: bool = False, to_server: bool = False) -> None:
        taken, given = ("/fib_mon", "/fib") if to_server else ("/fib", "/fib_mon")
        topic = rospy.Publisher(f"{given}/{name}", kind, latch=name == "status", queue_size=DEPTH, tcp_nodelay=True)

        def take(message: Any) -> None:
            if not asked:
                topic.publish(message)
            link.ask("{}", (lambda: topic.publish(message)) if asked else lambda: None)

        rospy.Subscriber(f"{taken}/{name}", rospy.AnyMsg, take, tcp_nodelay=True)

    repeat(TestActionGoal, "goal", asked=True, to_server=True)
    repeat(GoalID, "cancel", to_server=True)
    repeat(TestActionFeedback, "feedback")
    repeat(TestActionResult, "result")
    repeat(GoalStatusArray, "status")


def bare(port: int) -> None:
    """The chain without logic, for the topic, the service and the action."""
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
    bare_action(link)
    say("ready")
    rospy.spin()


ACTION = """
  - ros_action: /fib
    type: actionlib/action/Test
    action: filter
    ask: [goal]
    goal: {signals: {order: msg.goal}}
    reply: {signals: {accepted: msg.accepted}}
    feedback: {signals: {number: msg.feedback}}
    result: {signals: {number: msg.result}}"""


def described() -> Ros:
    port = free_port()
    return Ros(
        script=__file__,
        adapter="oracle_ros1",
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
        action=ACTION,
        settings={"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"},
        core=("roscore", "-p", str(port)),
    )


if __name__ == "__main__":
    main(described(), __doc__)
