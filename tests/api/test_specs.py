"""Specs over HTTP: what is told of them, and those that can't be kept."""

from __future__ import annotations

from pathlib import Path

from tests.api.conftest import Asked

SPEC = "id: new\nstreams: [{topic: /a, signals: {v: msg.v}}]\nproperties: [{id: p, formula: '{v > 1}'}]\n"


async def test_a_spec_that_can_not_be_written_is_not_taken_in(asked: Asked, tmp_path: Path) -> None:
    (tmp_path / "put").write_text("a file where the folder of uploads is to be", encoding="utf-8")
    answer = await asked.http.put("/api/v1/specs/new", content=SPEC)
    assert answer.status_code == 503
    assert "can't be kept" in answer.json()["detail"]
    assert (await asked.http.get("/api/v1/specs/new")).status_code == 404
    (tmp_path / "put").unlink()
    assert (await asked.http.put("/api/v1/specs/new", content=SPEC)).status_code == 201


async def test_a_spec_tells_its_derived_signals_where_it_has_some(asked: Asked) -> None:
    derived = "derive:\n  seen: {rate: '{topic: /a}', over: 2s}\n  twice: seen * 2\n"
    text = f"id: more\nstreams: [{{topic: /a}}]\n{derived}properties: [{{id: p, formula: '{{twice > 1}}'}}]\n"
    document = (await asked.http.put("/api/v1/specs/more", content=text)).json()
    assert document["derive"] == [
        {"name": "seen", "signal": "rate of {topic: /a} over 2s"},
        {"name": "twice", "signal": "seen * 2"},
    ]
    listed = (await asked.http.get("/api/v1/specs")).json()["items"]
    assert [spec["id"] for spec in listed if "derive" in spec] == ["more"]
