"""A service, or a proxied action, that nobody serves on real ROS 1, as where the spec misspells it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from actionlib import msg
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


@pytest.mark.parametrize("how", [{}, {"via": "introspection", "proxy": ""}], ids=["proxied", "observed"])
def test_an_action_is_told(how: dict[str, str], tmp_path: Path) -> None:
    with watched(tmp_path, streams("goal", name="/counts", **how)) as (scene, oracle, process):
        serving = server(scene, count)
        process.said("/counts: nobody serves /counts; did you mean /count[?]")
        eventually(oracle.troubles, ["nobody serves /counts; did you mean /count?"].__eq__)
        serving.serve_action(msg.TestAction, "/counts", count)
        process.said("/counts: recovered")
        process.ends_well()
