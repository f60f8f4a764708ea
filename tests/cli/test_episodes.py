"""Episodes as a table: how long each lasted, and the worst of it."""

from __future__ import annotations

import io
import json
from contextlib import redirect_stdout
from typing import Any, cast

from oracle_server.cli.client import Client
from oracle_server.cli.episodes import show_episodes

SECOND = 10**9
ENDED: dict[str, Any] = {
    "session": "s", "spec": "spec", "property": "p", "order": "publication", "first": 3, "began": 4 * SECOND, "last": 9,
    "until": 6 * SECOND + SECOND // 2, "open": False, "final": False, "count": 12,
    "worst": {"signal": "v", "op": "<=", "bound": 1.0, "value": 1.4}, "explanation": "p does not hold at step 3",
}  # fmt: skip
OPEN = ENDED | {"first": 20, "last": None, "until": None, "open": True, "worst": None, "explanation": None}
FINAL = OPEN | {"final": True, "worst": {"robustness": -0.5}}


class Told:
    """A client of a server that has these episodes, and keeps what it was asked."""

    def __init__(self, *episodes: dict[str, Any]) -> None:
        self.asked: list[tuple[str, dict[str, Any]]] = []
        self._episodes = list(episodes)

    def get(self, _: str, **__: object) -> dict[str, Any]:
        return {"properties": []}

    def pages(self, path: str, **query: Any) -> list[dict[str, Any]]:
        self.asked.append((path, query))
        return self._episodes


def shown(client: Told, session: str | None = "s", *, only_open: bool = False, as_json: bool = False) -> str:
    with redirect_stdout(io.StringIO()) as out:
        show_episodes(cast("Client", client), session, [], only_open=only_open, as_json=as_json)
    return out.getvalue()


def test_each_is_a_row_with_how_long_it_lasted_and_its_worst() -> None:
    head, ended, is_open, final, *said = shown(Told(ENDED, OPEN, FINAL)).splitlines()
    assert head.split() == ["property", "began", "lasted", "violations", "worst", "first", "last"]
    assert ended.split() == ["p", "4.000", "s", "2.500", "s", "12", "v", "=", "1.4,", "wanted", "<=", "1", "3", "9"]
    assert is_open.split() == ["p", "4.000", "s", "open", "12", "-", "20", "-"]
    assert final.split() == ["p", "4.000", "s", "for", "good", "12", "robustness", "-0.5", "20", "-"]
    assert "p does not hold at step 3 (#3)" in said


def test_of_all_sessions_each_row_says_whose_it_is() -> None:
    client = Told(ENDED)
    assert shown(client, None, only_open=True).splitlines()[1].startswith("s ")
    assert client.asked == [("episodes", {"property": [], "open": True, "origin": None})]


def test_as_json_it_is_what_the_server_says() -> None:
    assert json.loads(shown(Told(ENDED), as_json=True)) == {"items": [ENDED]}
