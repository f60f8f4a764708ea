"""The table of sessions says that there may be more closed ones than it has."""

from __future__ import annotations

from typing import Any, cast

import pytest

from oracle_server.cli import tables
from oracle_server.cli.client import Client
from oracle_server.cli.top import Top


class Listing:
    """A client of a server that lists so many closed sessions."""

    def __init__(self, count: int) -> None:
        self._count = count

    def get(self, path: str, **_: object) -> dict[str, Any]:
        assert path == "sessions"
        counters = {"steps": 1, "held": 0}
        common = {"spec": "single", "status": "closed", "monitors": [], "properties": [], "counters": counters}
        return {"items": [common | {"id": f"s{i}"} for i in range(self._count)]}


class Idle(Listing):
    """A client of a server in whose session nothing was asked of a property."""

    def get(self, path: str, **_: object) -> dict[str, Any]:
        row = {"id": "stops", "violations": 0, "first_violation": None, "unasked": "{fault}", "caveats": []}
        (state,) = super().get(path)["items"]
        return {"items": [state | {"status": "open", "properties": [row], "live": True, "idle": False}]}

    def pages(self, *_: object, **__: object) -> list[dict[str, Any]]:
        return []


def test_it_says_of_what_nothing_was_asked(capsys: pytest.CaptureFixture[str]) -> None:
    client = cast(Client, Idle(1))
    tables.show_sessions(client, as_json=False)
    assert "s0: nothing was asked of stops\n" in capsys.readouterr().out
    ((*_, doubt),) = Top(client).rows()
    assert doubt == "nothing was asked of stops"


@pytest.mark.parametrize(("count", "told"), [(2, False), (3, True)])
def test_it_says_that_earlier_ones_are_not_listed(
    count: int, told: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tables, "LISTED", 3)
    tables.show_sessions(cast(Client, Listing(count)), as_json=False)
    printed = capsys.readouterr().out
    assert "s0" in printed
    assert ("of closed sessions these are the last 3; `verdicts SESSION` tells of any" in printed) == told
