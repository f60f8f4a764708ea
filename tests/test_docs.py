"""What the documents show is true: whole specs are sound, files that they name are there, and nothing is left out."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from oracle_server.core.signals import Projection
from oracle_server.process.settings import Settings
from oracle_server.remote.receivers import load_receivers
from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.model import (
    ActionModel,
    DeriveModel,
    OrderingModel,
    PartModel,
    PropertyModel,
    RetentionModel,
    ServiceModel,
    SpecModel,
    StampModel,
    TopicModel,
)
from tests.pages import ADDRESS, steps
from tests.processes import PATIENCE
from tests.whole.harness import Server

ROOT = Path(__file__).parents[1]
DOCUMENTS = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted(ROOT.glob("examples/*/README.md")),
]
SPECS = [
    pytest.param(block, id=f"{path.name}-{i}")
    for path in DOCUMENTS
    for i, block in enumerate(re.findall(r"```yaml\n(.*?)```", path.read_text(), re.DOTALL))
    if "properties:" in block and "…" not in block
]

PARTS = [
    pytest.param(block, id=f"{path.name}-{i}")
    for path in DOCUMENTS
    for i, block in enumerate(re.findall(r"```yaml\n(.*?)```", path.read_text(), re.DOTALL))
    if "properties:" not in block or "…" in block
]
AROUND = """
id: around
{keys}streams:
  - {{topic: /a}}
  - {{topic: /chatter, action: filter}}
  - {{topic: /goal, signals: {{id: msg.id}}}}
  - {{topic: /status, signals: {{id: msg.id, status: msg.status}}}}
  - {{service: /SetLED, action: filter}}
{streams}properties:
  - {{id: p, formula: '{{topic: /a}}', guards: [/chatter, /SetLED]}}
{properties}"""
"""A spec around a part of one."""
PLACES = {"  - id: ": "properties", "  - topic: ": "streams", "retention: ": "keys"}
"""Where a part goes, by how it begins."""
NO_SPECS = {
    "judge:": "test_a_job_runs_what_its_page_shows",
    "- uses:": "test_the_job_on_github_gives_what_the_action_takes",
    "monitors:": "tests/test_pages.py",
    "alarms:": "test_the_alarms_shown_are_taken",
}
"""How blocks begin that are no part of a spec, and what reads them."""


@pytest.mark.parametrize("text", SPECS)
def test_specs_in_the_documents_are_sound(text: str) -> None:
    assert parse_spec(text, "document").spec.properties


@pytest.mark.parametrize("text", PARTS)
def test_parts_of_specs_in_the_documents_are_sound(text: str) -> None:
    if text.startswith(tuple(NO_SPECS)):
        return
    (place,) = [place for beginning, place in PLACES.items() if text.startswith(beginning)]
    parts = dict.fromkeys(PLACES.values(), "") | {place: text}
    assert parse_spec(AROUND.format(**parts), "document").spec.properties


def test_the_job_on_github_gives_what_the_action_takes() -> None:
    text = (ROOT / "docs" / "installing.md").read_text()
    ((*_, step),) = [yaml.safe_load(block) for block in re.findall(r"```yaml\n(- uses:.*?)```", text, re.DOTALL)]
    inputs = yaml.safe_load((ROOT / "action.yml").read_text())["inputs"]
    assert {name for name, of in inputs.items() if of.get("required")} <= step["with"].keys() <= inputs.keys()
    assert {"types", "strict"} <= inputs.keys()  # as the text below has it


def test_the_alarms_shown_are_taken(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "operations.md").read_text()
    (block,) = re.findall(r"```yaml\n(alarms:.*?)```", text, re.DOTALL)
    secret = tmp_path / "alarms.secret"
    secret.write_text("0" * 32)
    secret.chmod(0o600)
    path = tmp_path / "alarms.yaml"
    path.write_text(block.replace("/etc/oracle/alarms.secret", str(secret)))
    assert [receiver.url for receiver in load_receivers(path)] == ["https://ops.example/oracle"]


def test_the_adapter_of_ones_own_is_attached_and_denied(tmp_path: Path) -> None:
    (block,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "adapters.md").read_text(), re.DOTALL)
    with Server(ROOT / "specs", tmp_path) as server:
        script = block.replace(ADDRESS, server.url) + "\nprint(passed, len(streams))"
        ran = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, encoding="utf-8", timeout=PATIENCE, check=False
        )
        assert (ran.returncode, ran.stderr) == (0, "")
        passed, streams = ran.stdout.split()
        assert (passed, int(streams) > 3) == ("False", True)
        assert {record["stream"] for record in server.records("flight1")} == {"/battery_status", "/SetLED"}


def test_a_job_runs_what_its_page_shows() -> None:
    text = (ROOT / "docs" / "ci.md").read_text()
    run = re.findall(r"^    - (oracle-server .*)$", text, re.MULTILINE)
    assert len(run) == 2
    assert set(run) <= {step.command for step in steps(text)}


def test_the_tutorial_shows_the_spec_that_init_writes() -> None:
    (text,) = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs/tutorial.md").read_text(), re.DOTALL)
    shown = parse_spec(text, "document").spec
    text = (ROOT / "oracle_server/starter/spec.yaml").read_text().replace("ROBOT", "myrobot")
    written = parse_spec(text, "starter").spec
    assert (shown.streams, shown.properties) == (written.streams, written.properties)


def test_expressions_in_the_documents_can_be_computed() -> None:
    text = (ROOT / "docs" / "spec.md").read_text()
    table = text[text.index("| expression | for |") : text.index("- **What an operand lacks")]
    told = [e for row in table.splitlines()[2:] for e in re.findall(r"`([^`]*msg[^`]*)`", row.replace("\\|", "|"))]
    message = {
        "pose": {"position": {"z": 2.5}}, "status": 2, "count": 7, "speed": 1.5, "x": 3, "y": 4.0,
        "position": [0.5], "name": ["a", "b"],
        "ranges": [1.5, "Infinity", "NaN", 0.25], "goal": {}, "frame_id": "map", "id": 7,
    }  # fmt: skip
    values = {e: Projection({"it": e})(message) for e in told}
    assert {e for e, (_, failed) in values.items() if failed} == set()
    assert values["sqrt(msg.x * msg.x + msg.y * msg.y)"][0] == {"it": 5.0}
    assert values["msg.ranges.exists(r, r != 'NaN' && r < 0.5)"][0] == {"it": True}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_named_in_the_documents_are_there(path: Path) -> None:
    text = path.read_text()
    links = [link for link in re.findall(r"\]\(([^)#]+)", text) if "://" not in link]
    links += [link for link in re.findall(r"^\[\w+\]: (\S+)$", text, re.MULTILINE) if "://" not in link]
    scripts = re.findall(r"(?:\./|\b)((?:scripts|benchmarks)/[\w/-]+(?:\.py)?)", text)
    scripts += re.findall(r"\bpytest (tests/[\w/]+\.py)", text)
    missing = [name for name in links if not (path.parent / name).exists()]
    missing += [name for name in scripts if not (ROOT / name).exists()]
    assert missing == []


def test_every_setting_is_told() -> None:
    text = (ROOT / "docs" / "operations.md").read_text()
    assert [name for name in Settings.model_fields if f"`ORACLE_{name.upper()}`" not in text] == []


def test_every_key_of_a_spec_is_told() -> None:
    text = (ROOT / "docs" / "spec.md").read_text()
    models = (
        DeriveModel,
        OrderingModel,
        TopicModel,
        ServiceModel,
        ActionModel,
        PartModel,
        StampModel,
        PropertyModel,
        RetentionModel,
        SpecModel,
    )
    keys = {name for model in models for name in model.model_fields}
    assert {key for key in keys if not re.search(rf"`{key}`|\b{key}:", text)} == set()


def test_the_architecture_has_every_module_in_its_package_and_no_other() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text()
    _, *sections = re.split(r"^###? ", text[text.index("## Module by module") :], flags=re.MULTILINE)
    told = {
        match[1]: sorted(re.findall(r"`(\w+\.py)`", section.split("`adapters/ros2", 1)[0]))
        for section in sections
        if (match := re.match(r"`([\w/]+)/`\n", section))
    }
    there = {}
    for package in ("oracle_server", "adapters/common/oracle_adapter", "adapters/ros1/oracle_ros1"):
        root = ROOT / package
        for folder in {path.parent for path in root.rglob("*.py")} - {ROOT / "oracle_server"}:
            name = folder.relative_to(root if package == "oracle_server" else ROOT).as_posix()
            there[name] = sorted(path.name for path in folder.glob("*.py") if not path.name.startswith("__"))
    told.pop("dashboard")
    assert told == there


def test_the_architecture_names_what_is_ros_2s_own() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text()
    names = {
        folder: {p.name for p in (ROOT / folder).glob("*.py")}
        for folder in ("adapters/ros1/oracle_ros1", "adapters/ros2/oracle_ros2")
    }
    own = names["adapters/ros2/oracle_ros2"] - names["adapters/ros1/oracle_ros1"]
    assert own
    assert all(f"`{name}`" in text for name in own)


def test_files_that_the_architecture_names_are_there() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text()
    paths = set(
        re.findall(
            r"`((?:core|engines|specfiles|wire|process|history|remote|review|sessions|replay|edge|attach|api)/[\w/]+\.py)`",
            text,
        )
    )
    assert len(paths) > 40
    assert [path for path in paths if not (ROOT / "oracle_server" / path).exists()] == []


def test_each_limit_names_the_tests_that_hold_it() -> None:
    page = ROOT / "docs" / "security.md"
    rows = [line.strip("| ").split(" | ") for line in page.read_text().splitlines() if line.startswith("| ")]
    limits = rows[[row[0] for row in rows].index("what") + 2 :]
    assert len(limits) > 15
    for row in limits:
        tests = re.findall(r"\]\((\.\./tests/.*?\.py)\)", row[-1])
        assert tests, row[0]
        assert all((page.parent / test).is_file() for test in tests), row[0]
