"""What nothing new may be called, since clients leave it out of paths."""

from __future__ import annotations

import pytest

from oracle_server.cli.client import ServerUnreachableError, of_session
from oracle_server.core.errors import OracleError
from oracle_server.wire.errors import WireError
from tests.api.conftest import Asked
from tests.sessions.making import Kept, attach

NAMES = (".", "..")


@pytest.mark.parametrize("name", NAMES)
async def test_nothing_new_is_called_so(name: str, asked: Asked) -> None:
    session = await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": name})
    sent = await asked.http.post("/api/v1/recordings", params={"spec": "single", "session": name}, content=b"{}")
    spec = await asked.http.put(f"/api/v1/specs/{name.replace('.', '%2E')}", content=f"id: {name}")
    for answer in (session, sent, spec):
        assert answer.status_code == 422
        assert f"can be called '{name}'" in answer.json()["detail"]
    with pytest.raises(WireError, match="take another name") as refused:
        await asked.registry.attach(attach(name, "single"), Kept())
    assert (refused.value.code, refused.value.fatal) == ("bad_attach", True)
    assert (await asked.http.get("/api/v1/sessions")).json()["items"] == []


@pytest.mark.parametrize("name", ["...", "a..b", ".a", "a."])
async def test_other_points_are_as_good_as_letters(name: str, asked: Asked) -> None:
    assert (await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": name})).status_code == 201
    assert (await asked.http.get(f"/api/v1/{of_session(name)}")).json()["id"] == name


@pytest.mark.parametrize("name", NAMES)
async def test_a_session_that_an_older_server_had_is_found_and_closed(
    name: str, asked: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def free(_: str | None) -> None: ...

    with monkeypatch.context() as older:
        older.setattr(asked.registry, "demand_free", free)
        await asked.registry.create("single", name)
    live, _ = await asked.registry.attach(attach(name, "single"), Kept())
    assert live.id == name
    assert (await asked.http.get(f"/api/v1/{of_session(name)}")).json()["id"] == name
    assert (await asked.http.get(f"/api/v1/{of_session(name, 'episodes')}")).json()["items"] == []
    assert (await asked.http.delete(f"/api/v1/{of_session(name)}")).json()["status"] == "closed"


def test_the_command_line_asks_for_no_session_without_a_name() -> None:
    with pytest.raises(ServerUnreachableError, match="lists all") as refused:
        of_session("", "episodes")
    assert isinstance(refused.value, OracleError)
    assert of_session("a/b?c", "verdicts") == "sessions/a%2Fb%3Fc/verdicts"
