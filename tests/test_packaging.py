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
import yaml
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


def test_the_server_starts_once_the_clock_is_set() -> None:
    """By the time of before, which a machine without a battery for its clock boots with, open sessions begin anew."""
    (after,) = re.findall("^After=(.*)$", (FOLDER / "oracle-server.service").read_text(), re.MULTILINE)
    assert {"time-set.target", "time-sync.target"} <= set(after.split())


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


@pytest.fixture(scope="module")
def metrics(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """The names of the samples that a server gives."""
    folder = tmp_path_factory.mktemp("server")
    with Server(copy_specs(folder / "specs"), folder / "data") as server:
        assert server.http.post("/api/v1/sessions", json={"spec": "single"}).status_code == 201
        text = server.http.get("/metrics").text
    return {sample.name for family in text_string_to_metric_families(text) for sample in family.samples}


def names(expressions: list[str]) -> set[str]:
    return set(re.findall(r"\b(?:oracle|process)_\w+", " ".join(expressions)))


BOARD = json.loads((FOLDER / "grafana-dashboard.json").read_text())


def test_the_dashboard_asks_for_what_there_is(metrics: set[str]) -> None:
    asked = names([target["expr"] for panel in BOARD["panels"] for target in panel["targets"]])
    assert len(asked) > 15
    assert asked <= metrics


def test_the_dashboard_is_as_grafana_takes_it() -> None:
    """The parts of its schema that it uses (39): ids, places on a grid of 24 columns, sources and queries."""
    assert BOARD["schemaVersion"] == 39
    panels = BOARD["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    taken: set[tuple[int, int]] = set()
    for panel in panels:
        place = panel["gridPos"]
        assert 0 <= place["x"] <= place["x"] + place["w"] <= 24
        cells = {
            (x, y)
            for x in range(place["x"], place["x"] + place["w"])
            for y in range(place["y"], place["y"] + place["h"])
        }
        assert not cells & taken, panel["title"]
        taken |= cells
        assert panel["type"] in ("timeseries", "table", "stat")
        assert panel["datasource"] == {"type": "prometheus", "uid": "${datasource}"}
        assert panel["fieldConfig"].keys() == {"defaults", "overrides"}
        refs = [target["refId"] for target in panel["targets"]]
        assert len(set(refs)) == len(refs)
        assert all(target["expr"].count("(") == target["expr"].count(")") for target in panel["targets"])
    variables = {variable["name"] for variable in BOARD["templating"]["list"]}
    used = re.findall(r"\$\{?(\w+)", json.dumps(panels))
    assert set(used) <= variables | {"__rate_interval"}


def test_the_rules_are_as_prometheus_takes_them_and_ask_for_what_there_is(metrics: set[str]) -> None:
    document = yaml.safe_load((FOLDER / "prometheus-rules.yml").read_text())
    assert document.keys() == {"groups"}
    rules = [rule for group in document["groups"] for rule in group["rules"]]
    assert len({rule["alert"] for rule in rules}) == len(rules) > 5
    for rule in rules:
        assert rule.keys() <= {"alert", "expr", "for", "labels", "annotations"}
        assert re.fullmatch(r"[A-Z]\w+", rule["alert"])
        assert re.fullmatch(r"\d+[smh]", rule.get("for", "1m"))
        assert rule["labels"]["severity"] in ("page", "warning", "info")
        assert rule["annotations"].keys() <= {"summary", "description"}
        assert rule["expr"].count("(") == rule["expr"].count(")")
    asked = names([rule["expr"] for rule in rules])
    assert len(asked) > 7
    assert asked <= metrics
