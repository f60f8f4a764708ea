"""A session that could not be restored is seen everywhere, with its reason, until it is closed."""

from __future__ import annotations

import asyncio
from pathlib import Path

from tests.whole.client import connected, make_attach
from tests.whole.conftest import copy_specs
from tests.whole.harness import Server, run
from tests.whole.unrestored import REASON, unrestored


async def test_a_session_that_could_not_be_restored_is_seen_and_closed(tmp_path: Path) -> None:
    specs, data = copy_specs(tmp_path / "specs"), tmp_path / "data"
    async with unrestored(specs, data) as server:
        state = server.get("sessions/s")
        assert state["status"] == "unrestored"
        assert state["trouble"].startswith(REASON)
        assert server.get("sessions")["items"] == [state]
        assert [record["outcome"] for record in server.records("s")] == ["currently_false"] * 2
        for command in (("sessions",), ("verdicts", "s")):
            shown = await asyncio.to_thread(run, *command, "--url", server.url)
            assert (shown.returncode, shown.stderr) == (0, "")
            assert REASON in shown.stdout
        async with connected(server) as monitor:
            await monitor.send(make_attach(session="s", spec="single"))
            error = await monitor.expect("error")
            assert error["code"] == "session_closed"
            assert "could not be restored, and can only be read or closed: s:1:1: the key " in error["message"]
        answer = server.http.delete("/api/v1/sessions/s")
        assert (answer.status_code, answer.json()["status"]) == (200, "closed")
        assert server.stop() == 0
    with Server(specs, data) as server:
        assert server.get("sessions/s") == answer.json()
        assert "can't be restored" not in server.log
