"""Closed sessions are listed up to a limit, of which others' sessions take nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from oracle_server.edge.tokens import add
from oracle_server.sessions import registry
from tests.api.conftest import Asked
from tests.processes import PATIENCE


@pytest.mark.parametrize(
    "bound", [{"sessions": ["mine"]}, {"specs": ["single"]}, {"specs": ["single"], "sessions": ["mine"]}]
)
async def test_sessions_of_others_do_not_displace_those_that_a_token_covers(
    bound: dict[str, list[str]], asked: Asked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "LISTED", 2)
    for name, spec in (("mine", "single"), ("mine.run2", "single"), ("other1", "pair"), ("other2", "pair")):
        await asked.registry.create(spec, name)
        await asked.registry.end(name, PATIENCE)
    secret = add(tmp_path / "no tokens", "one", ["read"], **bound)
    answer = await asked.http.get("/api/v1/sessions", headers={"Authorization": f"Bearer {secret}"})
    listed: list[dict[str, Any]] = answer.json()["items"]
    assert [state["id"] for state in listed] == ["mine.run2", "mine"]
