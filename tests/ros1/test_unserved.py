"""A service, or a proxied action, that nobody serves on real ROS 1, as where the spec misspells it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from actionlib import msg
from oracle_adapter import unpublished
from oracle_ros1.graph import Graph
from oracle_ros1.unserved import UnservedAction, UnservedService
from std_srvs.srv import SetBool, SetBoolResponse

from tests.processes import eventually
from tests.robot import spec_folder
from tests.ros1.actionscene import count, server, streams, watched
from tests.ros1.harness import Scene

SERVICE = """
id: lamp
streams:
  - {service: /SetLamp, type: std_srvs/SetBool}
properties:
  - {id: never_on, formula: 'not {kind: request, data: true}'}
"""


def obey(_: Any) -> SetBoolResponse:
    return SetBoolResponse(success=True)


def test_a_service_is_told_with_what_it_is_called_here(tmp_path: Path) -> None:
    def troubles() -> list[str]:
        return [s["trouble"] for m in scene.server.session("s")["monitors"] for s in m["streams"]]

    with Scene(tmp_path, spec_folder(tmp_path, SERVICE)) as scene:
        adapter, peer = scene.adapter("lamp"), scene.peer()
        peer.serve(SetBool, "/set_lamp", obey)
        text = "nobody serves /SetLamp; did you mean /set_lamp?"
        adapter.said(re.escape(f"/SetLamp: {text}"))
        eventually(troubles, lambda found: text in found)
        peer.serve(SetBool, "/SetLamp", obey)
        adapter.said("/SetLamp: recovered")
        eventually(troubles, lambda found: text not in found)
        adapter.ends_well()


class Known(Graph):
    """What a master tells where another monitor was killed."""

    answers = 1

    def __init__(self) -> None:
        """Ask nobody."""

    def publishers(self, topic: str) -> list[str]:
        return ["/uav2"] if topic == "/go_mon/status" else []

    def published(self) -> list[str]:
        return ["/go_mon/status"]

    def is_served(self, service: str) -> bool:
        return service == "/go_mon"

    def served(self) -> list[str]:
        return ["/go_mon"]


@pytest.mark.parametrize("unserved", [UnservedAction, UnservedService])
def test_the_proxy_of_another_monitor_is_not_what_was_meant(
    unserved: type[UnservedAction | UnservedService], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpublished, "PATIENCE", 0.0)
    assert unserved(Known(), "/go", "/go_mon").look() == "nobody serves /go"


@pytest.mark.parametrize("how", [{}, {"via": "introspection", "proxy": ""}], ids=["proxied", "observed"])
def test_an_action_is_told(how: dict[str, str], tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", name="/counts", **how)) as (scene, oracle, process):
        serving = server(scene, count)
        process.said("/counts: nobody serves /counts; did you mean /count[?]")
        eventually(oracle.troubles, ["nobody serves /counts; did you mean /count?"].__eq__)
        serving.serve_action(msg.TestAction, "/counts", count)
        process.said("/counts: recovered")
        process.ends_well()
