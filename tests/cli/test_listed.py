"""The table of sessions says that there may be more closed ones than it has."""

from __future__ import annotations

from typing import Any, cast

import pytest

from oracle_server.cli import tables
from oracle_server.cli.client import Client


class Listing:
    """A client of a server that lists so many closed sessions."""

    def __init__(self, count: int) -> None:
        self._count = count

    def get(self, path: str, **_: object) -> dict[str, Any]:
        assert path == "sessions"
        common = {"spec": "single", "status": "closed", "monitors": [], "properties": [], "counters": {"steps": 1}}
        return {"items": [common | {"id": f"s{i}"} for i in range(self._count)]}


@pytest.mark.parametrize(("count", "told"), [(2, False), (3, True)])
def test_it_says_that_earlier_ones_are_not_listed(
    count: int, told: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tables, "LISTED", 3)
    tables.show_sessions(cast(Client, Listing(count)), as_json=False)
    printed = capsys.readouterr().out
    assert "s0" in printed
    assert ("of closed sessions these are the last 3; `verdicts SESSION` tells of any" in printed) == told
