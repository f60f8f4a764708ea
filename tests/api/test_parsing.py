"""Reading a spec can take seconds: nobody waits for that but who asked for it."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest
from starlette.websockets import WebSocket

from oracle_server.attach.connection import Connection
from oracle_server.core.errors import SpecError
from oracle_server.edge.tokens import Grant
from oracle_server.specfiles import library
from oracle_server.specfiles.load import load_spec, parse_spec
from oracle_server.wire.incoming import Attach
from tests.api.conftest import Asked
from tests.attach.test_resting import Socket
from tests.processes import PATIENCE
from tests.sessions.making import Kept

SPEC = "id: x\nstreams:\n  - topic: /a\nproperties:\n  - {id: p, formula: '{v: %s}'}\n"
UNSOUND = SPEC % 1 + "colour: red\n"


@pytest.fixture
def threads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the threads in which specs are read, one for each time."""
    found: list[str] = []

    def noted(read: Callable[..., Any]) -> Callable[..., Any]:
        def reading(*args: Any, **options: Any) -> Any:
            found.append(threading.current_thread().name)
            return read(*args, **options)

        return reading

    for name in ("load_spec", "parse_spec"):
        monkeypatch.setattr(library, name, noted(getattr(library, name)))
    return found


async def attach(asked: Asked, session: str) -> None:
    await asked.registry.attach(
        Attach(type="attach", monitor="m", instance="i", session=session, spec="single"), Kept()
    )


async def opened(asked: Asked, session: str) -> None:
    assert (await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": session})).status_code == 201


async def shown(asked: Asked, _: str) -> None:
    assert (await asked.http.get("/api/v1/specs/single")).status_code == 200


async def listed(asked: Asked, _: str) -> None:
    assert (await asked.http.get("/api/v1/specs")).status_code == 200


@pytest.mark.parametrize("ask", [attach, opened, shown, listed])
async def test_a_changed_file_is_read_in_a_thread(
    asked: Asked, tmp_path: Path, threads: list[str], ask: Callable[[Asked, str], Any]
) -> None:
    path = tmp_path / "specs" / "single.yaml"
    path.write_text(path.read_text() + "# changed\n")
    await ask(asked, "one")
    assert len(threads) == 1
    assert threads[0].startswith("spec reading")
    await ask(asked, "two")
    assert len(threads) == 1, "it is read once"


async def test_what_is_put_is_read_in_a_thread(asked: Asked, threads: list[str]) -> None:
    for text, status in ((SPEC % 1, 201), (UNSOUND, 422), (SPEC % 2, 200)):
        assert (await asked.http.put("/api/v1/specs/x", content=text)).status_code == status
    assert [name.rsplit("_", 1)[0] for name in threads] == ["spec upload"] * 3


async def test_specs_on_hand_wait_for_none_that_is_read(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    reading, going = threading.Event(), threading.Event()

    def slowly(*args: Any, **options: Any) -> Any:
        reading.set()
        going.wait(PATIENCE)
        return parse_spec(*args, **options)

    monkeypatch.setattr(library, "parse_spec", slowly)
    async with asyncio.timeout(PATIENCE):
        putting = asyncio.create_task(asked.http.put("/api/v1/specs/x", content=SPEC % 1))
        await asyncio.to_thread(reading.wait, PATIENCE)
        await attach(asked, "one")
        await listed(asked, "one")
        assert not putting.done()
        going.set()
        assert (await putting).status_code == 201


async def test_a_changed_file_is_refused_with_its_reasons_and_is_not_read_again_for_that(
    asked: Asked, tmp_path: Path, threads: list[str]
) -> None:
    path = tmp_path / "specs" / "single.yaml"
    sound = path.read_text()
    path.write_text(sound + "colour: red\n")
    for _ in range(2):
        found = (await asked.http.get("/api/v1/specs/single")).json()
        assert found["status"] == 422
        assert "single.yaml:" in found["detail"]
        assert "colour" in found["detail"]
        (problem,) = [s["problem"] for s in (await asked.http.get("/api/v1/specs")).json()["items"] if s.get("problem")]
        assert problem == found["detail"]
        with pytest.raises(SpecError, match="colour"):
            await asked.registry.create("single", "s")
        socket = Socket()
        socket.state = type("State", (), {"grant": Grant(frozenset({"submit"}))})()
        socket.says({"type": "attach", "monitor": "m", "instance": "i", "session": "s", "spec": "single"})
        await Connection(cast("WebSocket", socket), asked.registry).serve()
        (error,) = await socket.hears("error")
        assert (error["code"], "colour" in error["message"]) == ("bad_spec", True)
    assert len(threads) == 1
    path.write_text(sound.replace("id: single", "id: other"))
    found = (await asked.http.get("/api/v1/specs/single")).json()
    assert "the id was 'single' and has changed" in found["detail"]
    path.write_text(sound)
    await shown(asked, "")
    await attach(asked, "s")


async def test_what_is_put_while_its_file_is_read_counts(
    asked: Asked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reading, going = threading.Event(), threading.Event()

    def slowly(*args: Any, **options: Any) -> Any:
        reading.set()
        going.wait(PATIENCE)
        return load_spec(*args, **options)

    path = tmp_path / "specs" / "single.yaml"
    text = path.read_text()
    path.write_text(text + "# changed\n")
    monkeypatch.setattr(library, "load_spec", slowly)
    async with asyncio.timeout(PATIENCE):
        getting = asyncio.create_task(asked.http.get("/api/v1/specs/single"))
        await asyncio.to_thread(reading.wait, PATIENCE)
        assert (await asked.http.put("/api/v1/specs/single", content=text + "# put\n")).status_code == 200
        going.set()
        assert (await getting).json()["text"].endswith("# put\n")
    assert (await asked.http.get("/api/v1/specs/single")).json()["source"] == "put"
