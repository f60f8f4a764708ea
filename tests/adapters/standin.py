"""An adapter's other side, whose every move a test makes: for tests on real ROS of what an adapter sends."""

from __future__ import annotations

from typing import Any

from tests.processes import Data

SWITCHES = ("/first", "/second", "/third", "/fourth")


def described(name: str, kind: str, type_: str, **more: Any) -> Data:
    """A stream as `attached` describes it."""
    plain: Data = {
        "name": name, "kind": kind, "type": type_, "action": "log", "intercept": "publisher", "proxy": "",
        "stamp": None, "latency": 20_000_000, "ordered": True, "fields": [], "reads": [],
        "on_unavailable": "deny", "decide_within": 60 * 10**9, "denied_response": None,
    }  # fmt: skip
    return {**plain, **more}


def switches() -> list[Data]:
    """Services that are filtered; SWITCHES has their names."""
    return [
        described(name, kind, "std_srvs/srv/SetBool", action="filter", proxy=f"{name}_mon")
        for name in SWITCHES
        for kind in ("request", "response")
    ]


def clocks_behind_an_ask(peer: Any) -> tuple[Data, list[Data]]:
    """The next event that asks, and what the first clocks behind it say."""
    frame = peer.recv()
    while not (frame["type"] == "event" and frame["ask"]):
        frame = peer.recv()
    asked = frame
    while frame["type"] != "clock":
        frame = peer.recv()
    return asked, frame["stamps"]


def check_clocks(peer: Any) -> None:
    """All services are spoken for behind an ask of one of them: else its decision would wait for the next clocks."""
    asked, stamps = clocks_behind_an_ask(peer)
    ahead = {(one["stream"], one["kind"]) for one in stamps if one["stamp"] >= asked["stamp"]}
    assert ahead == {(name, kind) for name in SWITCHES for kind in ("request", "response")}
