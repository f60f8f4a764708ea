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
    served = node.create_service(SetBool, "/late", Later(lambda _, reply: reply(SetBool.Response(message="here"))))
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
