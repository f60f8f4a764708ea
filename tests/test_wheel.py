"""The wheel and the sdist have what they need and no more; the wheel works where nothing else of the project is."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import NamedTuple

import httpx
import pytest

from tests.pages import steps
from tests.processes import PATIENCE, ROOT, Process

UV = shutil.which("uv", path=str(Path(sys.executable).parent)) or shutil.which("uv")
pytestmark = pytest.mark.skipif(UV is None and not os.environ.get("CI"), reason="uv is not installed")


class Built(NamedTuple):
    """An environment with what was built, and nothing else of the project; a home with nothing in it."""

    folder: Path
    sdist: Path
    wheel: Path
    home: Path

    def run(self, *words: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Run an installed command from the home."""
        command = self.folder / "venv" / "bin" / words[0]
        where = cwd or self.home
        return subprocess.run(
            [command, *words[1:]], cwd=where, env=self.environment, capture_output=True, encoding="utf-8", check=False
        )

    @property
    def environment(self) -> dict[str, str]:
        """With an empty home, and without anything that points to the project."""
        kept = {name: value for name, value in os.environ.items() if name.startswith(("SSL_",))}
        return kept | {"HOME": str(self.home), "PATH": "/usr/bin:/bin", "ORACLE_PORT": "0"}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """The wheel is built from the sdist, as installers do it, and installed with all that it needs."""
    folder = tmp_path_factory.mktemp("built")
    uv("build", "--quiet", "--out-dir", folder, ROOT)
    uv("venv", "--quiet", "--python", sys.executable, folder / "venv")
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    uv("pip", "install", "--quiet", "--python", folder / "venv" / "bin" / "python", wheel)
    (folder / "home").mkdir()
    return Built(folder, sdist, wheel, folder / "home")


@pytest.fixture(scope="module")
def oldest(built: Built, tmp_path_factory: pytest.TempPathFactory) -> Built:
    """The wheel with the oldest of each package that it says to work with, beside the newest of what those need."""
    folder = tmp_path_factory.mktemp("oldest")
    uv("venv", "--quiet", "--python", sys.executable, folder / "venv")
    python = folder / "venv" / "bin" / "python"
    # by its folder: what a wheel needs is not direct for uv, which takes the newest of it
    uv("pip", "install", "--quiet", "--resolution", "lowest-direct", "--python", python, ROOT)
    (folder / "home").mkdir()
    return Built(folder, built.sdist, built.wheel, folder / "home")


def uv(*words: str | Path) -> None:
    """It builds and installs as pip does, in a fraction of the time."""
    assert UV is not None
    subprocess.run([UV, *words], check=True, timeout=10 * PATIENCE, stdout=subprocess.DEVNULL)


def test_the_sdist_has_the_documents_and_no_tests(built: Built) -> None:
    with tarfile.open(built.sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {
        "README.md",
        "CHANGELOG.md",
        "LICENSE",
        "pyproject.toml",
        "docs/spec.md",
        "docs/pictures/session.png",
    } <= names
    assert "specs/battery_uav.yaml" in names
    assert [name for name in names if name.startswith(("tests/", "benchmarks/", "."))] in ([], [".gitignore"])


def test_the_wheel_has_the_dashboard_and_every_example(built: Built) -> None:
    with zipfile.ZipFile(built.wheel) as archive:
        names = set(archive.namelist())
    files = [
        path for top in ("oracle_server", "specs", "examples") for path in (ROOT / top).rglob("*") if path.is_file()
    ]
    there = [path.relative_to(ROOT).as_posix() for path in files if "__pycache__" not in path.parts]
    pages = [name for name in there if name.startswith("oracle_server/")]
    shipped = [
        f"oracle_server/shipped/{name}"
        for name in there
        if re.fullmatch(r"specs/.*|examples/[^/]*/([^/]*\.yaml|README\.md|(traces|types|ros2/\w*_msgs)/.*)", name)
    ]
    assert len(shipped) > 60
    assert {*pages, *shipped} <= names
    assert {name.split("/")[0] for name in names} == {"oracle_server"} | {
        f"oracle_server-0.1.0.{kind}" for kind in ("data", "dist-info")
    }


@pytest.mark.parametrize("packages", ["built", "oldest"])
def test_what_init_prints_works_from_an_empty_home(packages: str, request: pytest.FixtureRequest) -> None:
    built: Built = request.getfixturevalue(packages)
    begun = built.run("oracle-server", "init", "myrobot")
    assert (begun.returncode, begun.stderr) == (0, "")
    folder = built.home / "myrobot"
    check, replay, serve = re.findall(r"^\$ (oracle-server .*)$", (folder / "README.md").read_text(), re.MULTILINE)
    checked = built.run(*check.split(), cwd=folder)
    assert (checked.returncode, checked.stderr) == (0, "")
    judged = built.run(*replay.split(), cwd=folder)
    assert judged.returncode == 1
    assert "violation: keeps_clear" in judged.stdout
    words = ["env", "-C", folder, built.folder / "venv/bin/oracle-server", *serve.split()[1:]]
    server = Process("the server", words, built.environment)
    try:
        url = server.said(r"accepting work .*url=(http://[\d.:]+)")[1]
        with httpx.Client(base_url=url, timeout=PATIENCE, trust_env=False) as http:
            assert "<title>" in http.get("/").raise_for_status().text
            http.get("/dashboard/main.js").raise_for_status()
            assert [spec["id"] for spec in http.get("/api/v1/specs").json()["items"]] == ["myrobot"]
            http.get("/api/v1/episodes").raise_for_status()
        assert server.end() == 0
    finally:
        server.remove()


def test_the_examples_commands_work_where_they_are_written(built: Built) -> None:
    assert built.run("oracle-server", "init", "--examples", "there").returncode == 0
    folder = built.home / "there"
    specs = [path.relative_to(folder).as_posix() for path in folder.rglob("*.yaml")]
    types = [f"--types={path.relative_to(folder)}" for path in folder.glob("examples/*/ros2/*_msgs")]
    types += [f"--types={path.relative_to(folder)}" for path in folder.glob("examples/*/types/*")]
    checked = built.run("oracle-server", "check", *types, *specs, cwd=folder)
    assert checked.returncode == 0, checked.stderr
    assert f"{len(specs)} specs sound" in checked.stdout
    commands = [step.command for step in steps((folder / "examples/rover/README.md").read_text())]
    assert [built.run(*command.split(), cwd=folder).returncode for command in commands] == [0, 1]
