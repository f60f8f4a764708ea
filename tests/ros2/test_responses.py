"""A response that the middleware could not send at first reaches its client all the same."""

from __future__ import annotations

import subprocess
import sys
import textwrap

import pytest

pytest.importorskip("rclpy")

# In a process of its own: pytest has warnings of its own way.
LATE = """
    import threading, warnings
    import rclpy
    from oracle_ros2.loop import Later, Loop
    from std_srvs.srv import SetBool

    rclpy.init()
    node, caller = rclpy.create_node("late"), rclpy.create_node("caller")
    later = Later(lambda _, reply: reply(SetBool.Response(message="here")), print)
    served = node.create_service(SetBool, "/late", later)
    send, tried = served.send_response, []

    def late(response, header):
        tried.append(header)
        if len(tried) < 4:  # as rclpy does where the middleware has not discovered the client
            warnings.warn("failed to send response (timeout): client will not receive response", RuntimeWarning)
        else:
            send(response, header)

    served.send_response = late
    loop = Loop(node)

    def serve():
        while len(tried) < 4:
            loop.turn()

    threading.Thread(target=serve, daemon=True).start()
    client = caller.create_client(SetBool, "/late")
    client.wait_for_service()
    answer = client.call_async(SetBool.Request(data=True))
    rclpy.spin_until_future_complete(caller, answer, timeout_sec=30)
    print(answer.result().message, len(tried))
"""


def test_a_response_is_sent_again_until_its_client_is_discovered() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(LATE)], capture_output=True, text=True, timeout=100, check=False
    )
    assert ended.stdout.split() == ["here", "4"], ended.stderr
    assert "failed to send" not in ended.stderr


ODD = """
    import sys, threading
    import rclpy
    from oracle_ros2.loop import Later, Loop, tell_unread
    from std_srvs.srv import SetBool

    # as a text in UTF-16 that ends in half a character: it is taken, and rclpy can't make a message of it
    type(SetBool.SIDE).__import_type_support__()
    known = {name: getattr(type(SetBool.SIDE), name) for name in dir(type(SetBool.SIDE)) if name.isupper()}
    del known["_CONVERT_TO_PY"]
    Odd = type("Odd", (type,), known)("Odd", (), {})

    class OddAtFirst:
        Request, Response = SetBool.Request, SetBool.Response

    OddAtFirst.SIDE = Odd
    rclpy.init()
    node, other = rclpy.create_node("late"), rclpy.create_node("other")
    unread = lambda why: print("a SIDE of /odd can't be read:", why, file=sys.stderr)
    if "SIDE" == "Request":
        later = Later(lambda _, reply: reply(SetBool.Response(message="here")), unread)
        served = node.create_service(SetBool, "/odd", later)
        served.srv_type = OddAtFirst
        client, odd = other.create_client(SetBool, "/odd"), served
    else:
        other.create_service(SetBool, "/odd", lambda _, answer: SetBool.Response(message="here"))
        client = odd = node.create_client(SetBool, "/odd")
        client.srv_type = OddAtFirst
        tell_unread(client, unread)
    answers = []
    loop = Loop(node)
    clock = rclpy.clock.Clock(clock_type=rclpy.clock.ClockType.STEADY_TIME)
    node.create_timer(0.01, lambda: None, clock=clock)
    executor = rclpy.executors.SingleThreadedExecutor()
    executor.add_node(other)
    while not client.service_is_ready():
        executor.spin_once(timeout_sec=0.01)
    for _ in range(2):
        answers.append(client.call_async(SetBool.Request(data=True)))
        if len(answers) == 1:
            for _ in range(100):
                loop.turn()
                executor.spin_once(timeout_sec=0.01)
            odd.srv_type = SetBool
            loop = Loop(node)
    while not answers[1].done():
        loop.turn()
        executor.spin_once(timeout_sec=0.01)
    print(answers[0].done(), answers[1].result().message)
"""


@pytest.mark.parametrize("side", ["Request", "Response"])
def test_a_call_that_can_not_be_read_is_told_and_ends_nothing(side: str) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(ODD.replace("SIDE", side))],
        capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert ended.stdout.split() == ["False", "here"], ended.stderr
    assert f"a {side} of /odd can't be read" in ended.stderr
