"""A monitor that can't be made."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from oracle_adapter import Attached, Names
from oracle_ros1 import monitor
from oracle_ros1.codec import CodecError

from tests.adapters.standin import described


def test_parts_forward_no_more_where_another_one_can_not_be_made(monkeypatch: pytest.MonkeyPatch) -> None:
    stopped: list[str] = []

    def make(_: object, interface: Any) -> object:
        if interface.name == "/c":
            raise CodecError("there is no such type")
        return SimpleNamespace(stop=lambda: stopped.append(interface.name))

    monkeypatch.setattr(monitor, "make_part", make)
    streams = tuple(described(name, "topic", "std_msgs/msg/Int64") for name in ("/a", "/b", "/c"))
    link: Any = SimpleNamespace()
    with pytest.raises(CodecError):
        monitor.Monitor(link, link, Names(), Attached("m", "s", "g", "d", streams, {}), simulated=False)
    assert stopped == ["/a", "/b"]
