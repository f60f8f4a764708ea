"""The containers' files fit each other and the server, as far as that can be told without an engine that runs them."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.processes import ROOT
from tests.whole.harness import COMMAND, Server, environment

sys.path.append(str(ROOT / "adapters/common"))
from oracle_adapter import command as adapter

FOLDER = ROOT / "packaging"
FILES = [FOLDER / "Containerfile", FOLDER / "Containerfile.ros2"]
COMPOSE: dict[str, Any] = yaml.safe_load((FOLDER / "compose.yaml").read_text())
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
FLEET: dict[str, Any] = yaml.safe_load((FOLDER / "compose.fleet.yaml").read_text())
EACH = [
    pytest.param(compose, service, id=f"{compose['name']}-{name}")
    for compose in (COMPOSE, FLEET)
    for name, service in compose["services"].items()
]
LINTER = shutil.which("hadolint", path=str(Path(sys.executable).parent))

_KEYS = {
    "build", "cap_drop", "command", "depends_on", "entrypoint", "environment", "healthcheck", "image", "init", "ports",
    "read_only", "restart", "security_opt", "tmpfs", "user", "volumes",
}  # fmt: skip
"""Those keys of a service in the Compose specification that are used here."""


def instructions(path: Path) -> list[tuple[str, str]]:
    """The instructions of a Containerfile, with their words."""
    text = re.sub(r"^#.*\n", "", path.read_text(), flags=re.MULTILINE).replace("\\\n", " ")
    return [(line.split()[0], line.split(maxsplit=1)[1]) for line in text.splitlines() if line.strip()]


@pytest.mark.skipif(LINTER is None and not os.environ.get("CI"), reason="hadolint is not installed")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_the_linter_finds_nothing(path: Path) -> None:
    assert LINTER is not None
    found = subprocess.run([LINTER, "--no-color", path], capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout) == (0, "")


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_images_end_without_rights_and_copy_what_there_is(path: Path) -> None:
    told = instructions(path)
    (user,) = [words for name, words in told if name == "USER"]
    assert user == "10001:10001"
    allowed = [line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")]
    assert all((ROOT / name).exists() for name in allowed)
    copied = [words.split()[0] for name, words in told if name == "COPY" and not words.startswith("--from")]
    assert copied
    for source in copied:
        assert source == "." or ((ROOT / source).is_dir() and source.split("/")[0] in allowed)
    assert all(not words.endswith(":latest") and ":" in words for name, words in told if name == "FROM")


def test_the_build_has_all_that_the_wheel_is_made_of() -> None:
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    wanted = [*wheel["include"], *(f"/{source}" for source in wheel["shared-data"]), "/README.md", "/LICENSE"]
    allowed = {line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    tops = {name.split("/")[1] for name in wanted}
    assert tops <= {name.split("/")[0] for name in allowed}
    assert wheel["shared-data"].keys() <= allowed


@pytest.mark.parametrize(("compose", "service"), EACH)
def test_no_service_has_rights_or_is_reached_from_elsewhere(compose: dict[str, Any], service: dict[str, Any]) -> None:
    assert service.keys() <= _KEYS
    assert service["read_only"] is True
    assert (service["cap_drop"], service["security_opt"]) == (["ALL"], ["no-new-privileges:true"])
    assert all(re.fullmatch(r"127\.0\.0\.1:\d+:\d+", port) for port in service.get("ports", ()))
    assert not service["image"].endswith(":latest")
    if "build" in service:
        build = service["build"]
        assert (FOLDER / build["context"] / build["dockerfile"]) in {
            FOLDER / ".." / f"packaging/{path.name}" for path in FILES
        }
    for volume in service.get("volumes", ()):
        source, target, *mode = volume.split(":")
        assert target.startswith("/")
        if source.startswith("."):
            assert (FOLDER / source).exists()
            assert mode == ["ro"]
        else:
            assert source in compose["volumes"]


def test_who_is_waited_for_tells_when_it_is_healthy() -> None:
    checked = {"oracle", *(name for name, service in SERVICES.items() if "healthcheck" in service)}
    assert "HEALTHCHECK" in dict(instructions(FILES[0]))
    waits = {name: service["depends_on"] for name, service in SERVICES.items() if "depends_on" in service}
    assert waits.keys() == {"adapter", "prometheus", "grafana"}
    for wanted in waits.values():
        assert wanted.keys() <= checked
        assert all(each == {"condition": "service_healthy"} for each in wanted.values())


def test_the_server_runs_as_its_image_has_it(tmp_path: Path) -> None:
    told = dict(instructions(FILES[0]))
    health = re.search(r"CMD \[(.*)\]$", told["HEALTHCHECK"])
    assert health is not None
    program, *words = re.findall(r'"([^"]+)"', health[1])
    assert (program, told["ENTRYPOINT"], told["CMD"]) == ("oracle-server", '["oracle-server"]', '["serve"]')
    image = dict(re.findall(r"(ORACLE_\w+)=(\S+)", told["ENV"]))
    assert SERVICES["oracle"]["volumes"] == [
        f"history:{image['ORACLE_DATA_DIR']}",
        f"../examples/turtle:{image['ORACLE_SPECS']}:ro",
    ]
    settings = image | SERVICES["oracle"]["environment"] | {"ORACLE_DATA_DIR": str(tmp_path)}

    def healthy() -> int:
        return subprocess.run(
            [COMMAND, *words], env=environment(**settings), check=False, capture_output=True
        ).returncode

    assert healthy() == 3
    specs = ROOT / "examples/turtle"
    kept = {
        name: value for name, value in settings.items() if name not in ("ORACLE_DATA_DIR", "ORACLE_SPECS", "ORACLE_LOG")
    }
    with Server(specs, tmp_path, **kept) as server:
        assert "http://0.0.0.0:" in server.url
        assert healthy() == 0
        scraped = server.http.get("/metrics", headers={"host": target()})
        assert scraped.status_code == 200
        assert "oracle_sessions" in scraped.text
        assert server.http.get("/", headers={"host": "elsewhere:8642"}).status_code == 421
        assert [spec["id"] for spec in server.get("specs")["items"]] == ["turtle"]
    assert healthy() == 3


def target() -> str:
    """What Prometheus asks for metrics."""
    scrape = yaml.safe_load((FOLDER / "prometheus.yml").read_text())
    ((job,),) = [scrape["scrape_configs"]]
    ((host,),) = [each["targets"] for each in job["static_configs"]]
    assert job["job_name"] == "oracle"  # as the rules and the dashboard have it
    assert isinstance(host, str)
    return host


def test_prometheus_asks_the_server_and_reads_the_rules() -> None:
    scrape = yaml.safe_load((FOLDER / "prometheus.yml").read_text())
    assert scrape.keys() == {"global", "rule_files", "scrape_configs"}
    assert target() == "oracle:8642"
    assert f"127.0.0.1:{target().split(':')[1]}:8642" in SERVICES["oracle"]["ports"]
    mounts = mounted("prometheus")
    assert mounts["/etc/prometheus/prometheus.yml"] == "./prometheus.yml"
    assert [mounts[path] for path in scrape["rule_files"]] == ["./prometheus-rules.yml"]
    options = dict(word.lstrip("-").split("=") for word in SERVICES["prometheus"]["command"])
    assert options["config.file"] in mounts
    assert mounts[options["storage.tsdb.path"]] == "prometheus"


def test_grafana_asks_prometheus_and_shows_the_dashboard() -> None:
    (source,) = yaml.safe_load((FOLDER / "grafana/datasources.yml").read_text())["datasources"]
    assert (source["type"], source["url"], source["isDefault"]) == ("prometheus", "http://prometheus:9090", True)
    (provider,) = yaml.safe_load((FOLDER / "grafana/dashboards.yml").read_text())["providers"]
    mounts = mounted("grafana")
    home = SERVICES["grafana"]["environment"]["GF_DASHBOARDS_DEFAULT_HOME_DASHBOARD_PATH"]
    assert str(Path(home).parent) == provider["options"]["path"]
    assert mounts[home] == "./grafana-dashboard.json"
    assert {path for path in mounts if "/provisioning/" in path} == {
        "/etc/grafana/provisioning/datasources/oracle.yml",
        "/etc/grafana/provisioning/dashboards/oracle.yml",
    }


def mounted(service: str) -> dict[str, str]:
    """What is mounted, by where."""
    return {volume.split(":")[1]: volume.split(":")[0] for volume in SERVICES[service]["volumes"]}


def test_the_robot_does_what_its_spec_observes() -> None:
    spec = yaml.safe_load((ROOT / "examples/turtle/turtle.yaml").read_text())
    program, option, module, *words = SERVICES["adapter"]["command"]
    assert (program, option, module) == ("python3", "-m", "oracle_ros2")
    asked = adapter.parser("oracle_ros2", None).parse_args(words)
    assert (asked.oracle, asked.spec) == ("http://oracle:8642", spec["id"])
    filtered = next(
        stream["topic"] for stream in spec["streams"] if stream.get("action") == "filter" and "topic" in stream
    )
    assert f"{filtered}_mon" in SERVICES["driver"]["command"]
