"""A server under limits that whoever started it has set."""

from __future__ import annotations

import asyncio
from pathlib import Path

import httpx

from tests.chaos.served import Served
from tests.processes import PATIENCE
from tests.whole.conftest import copy_specs
from tests.whole.test_recordings import OVER, log

_BOUNDED = """
import resource
resource.setrlimit(resource.RLIMIT_AS, (2**31 - 2**20, 2**31 - 2**20))
resource.setrlimit(resource.RLIMIT_FSIZE, (2**28, 2**28))
"""
"""As by `ulimit -v` and `ulimit -f`: less than what is judged and checked beside the server may take."""


async def test_recordings_are_judged_and_specs_checked_within_them(tmp_path: Path) -> None:
    specs = copy_specs(tmp_path / "specs", ["single"])
    served = Served(specs, tmp_path / "data", _BOUNDED)
    recording, spec = log(tmp_path / "log.jsonl").read_bytes(), (specs / "single.yaml").read_bytes()
    try:
        await served.start()
        async with httpx.AsyncClient(base_url=f"{served.url}/api/v1", timeout=PATIENCE) as http:
            sent = await http.post("recordings", params={"spec": "single", "name": "log.jsonl"}, content=recording)
            assert sent.status_code == 202, sent.text
            async with asyncio.timeout(PATIENCE):
                while (found := (await http.get(f"recordings/{sent.json()['id']}")).json())["state"] not in OVER:
                    await asyncio.sleep(0.01)
            assert (found["state"], found["error"], found["events"]) == ("judged", None, 100)
            checked = await http.post("specs/single/check", content=spec)
            assert (checked.status_code, checked.json()["sound"]) == (200, True)
        assert await served.stop() == 0
        assert served.complaints == []
    finally:
        await served.close()
