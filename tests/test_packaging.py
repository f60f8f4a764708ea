"""What is packaged with the server fits it."""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import subprocess
from pathlib import Path

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families

from tests.chaos.served import Served
from tests.processes import PATIENCE
from tests.whole.conftest import copy_specs
from tests.whole.harness import Server

FOLDER = Path(__file__).parents[1] / "packaging"


_DENY_WRITE_EXECUTE = """
import ctypes, mmap
assert ctypes.CDLL(None).prctl(65, 1, 0, 0, 0) == 0  # PR_SET_MDWE
try:
    mmap.mmap(-1, 4096, prot=mmap.PROT_WRITE | mmap.PROT_EXEC)
except PermissionError:
    pass
else:
    raise AssertionError("memory is still writable and executable")
"""
_KERNEL = tuple(map(int, re.findall(r"\d+", platform.release())[:2]))


@pytest.mark.skipif(
    shutil.which("systemd-analyze") is None and not os.environ.get("CI"), reason="systemd-analyze is not installed"
)
def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    unit = tmp_path / "oracle-server.service"
    text = (FOLDER / "oracle-server.service").read_text()
    unit.write_text(re.sub(r"ExecStart=\S+", "ExecStart=/bin/true", text))
    verified = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False)
    assert (verified.returncode, verified.stderr) == (0, "")
    exposure = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=20", unit],
        capture_output=True,
        text=True,
        check=False,
    )
    assert exposure.returncode == 0, exposure.stdout[-500:]


@pytest.mark.skipif(
    (platform.system(), _KERNEL) < ("Linux", (6, 3)), reason="before Linux 6.3 systemd alone can deny such memory"
)
async def test_the_server_needs_no_memory_that_is_writable_and_executable(tmp_path: Path) -> None:
    """As `MemoryDenyWriteExecute` denies it; the engines' compiled libraries are loaded with their sessions."""
    served = Served(copy_specs(tmp_path / "specs"), tmp_path / "data", _DENY_WRITE_EXECUTE)
    try:
        await served.start()
        async with httpx.AsyncClient(base_url=f"{served.url}/api/v1", timeout=PATIENCE) as http:
            specs = [spec["id"] for spec in (await http.get("specs")).json()["items"] if not spec.get("problem")]
            assert "reelay" in specs
            for spec in specs:
                answer = await http.post("sessions", json={"spec": spec, "id": spec})
                assert answer.status_code == 201, answer.text
        assert await served.stop() == 0
        assert served.complaints == []
    finally:
        await served.close()


def test_the_dashboard_asks_for_what_there_is(tmp_path: Path) -> None:
    specs = tmp_path / "specs"
    specs.mkdir()
    with Server(specs, tmp_path / "data") as server:
        text = server.http.get("/metrics").text
    there = {sample.name for family in text_string_to_metric_families(text) for sample in family.samples}
    board = json.loads((FOLDER / "grafana-dashboard.json").read_text())
    asked = [target["expr"] for panel in board["panels"] for target in panel["targets"]]
    names = set(re.findall(r"\b(?:oracle|process)_\w+", " ".join(asked)))
    assert len(names) > 15
    assert names <= there
