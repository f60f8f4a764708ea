"""A server whose folders have names that are no text: any bytes can stand in a path."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.whole.client import attached, make_event
from tests.whole.conftest import copy_specs
from tests.whole.harness import Server
from tests.whole.test_recordings import judged, log


@pytest.mark.parametrize("locale", [{}, {"LC_ALL": "C", "PYTHONUTF8": "0"}])
async def test_what_processes_beside_the_server_are_told_may_be_no_text(locale: dict[str, str], tmp_path: Path) -> None:
    specs = copy_specs(tmp_path / "specs", ["single"])
    types = tmp_path / "týpes\udcff"
    (types / "some_msgs" / "msg").mkdir(parents=True)
    (types / "some_msgs" / "msg" / "A.msg").write_text("int64 v\n")
    with Server(specs, tmp_path / "dätä\udcff", ORACLE_TYPES=str(types), **locale) as server:
        async with attached(server, session="s", spec="single") as monitor:
            await monitor.send(make_event(1, data={"v": 11}))
            await monitor.acked(1)
        assert [record["outcome"] for record in server.records("s")] == ["currently_false"]
        found = await judged(server, log(tmp_path / "log.jsonl"), "single", session="r")
        assert (found["events"], found["exit"]) == (100, 1)
        assert len(server.records("r")) == 100
