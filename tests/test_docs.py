"""What the documents show is true: whole specs are sound, files that they name are there, and nothing is left out."""

import re
from collections import Counter
from pathlib import Path

import pytest

from oracle_server.core.signals import Projection
from oracle_server.process.settings import Settings
from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.model import (
    OrderingModel,
    PropertyModel,
    RetentionModel,
    ServiceModel,
    SpecModel,
    TopicModel,
)

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted(ROOT.glob("examples/*/README.md"))]
SPECS = [
    pytest.param(block, id=f"{path.name}-{i}")
    for path in DOCUMENTS
    for i, block in enumerate(re.findall(r"```yaml\n(.*?)```", path.read_text(), re.DOTALL))
    if "properties:" in block and "…" not in block
]


@pytest.mark.parametrize("text", SPECS)
def test_specs_in_the_documents_are_sound(text: str) -> None:
    assert parse_spec(text, "document").spec.properties


def test_expressions_in_the_documents_can_be_computed() -> None:
    text = (ROOT / "docs" / "spec.md").read_text()
    table = text[text.index("| expression | for |") : text.index("An expression has at most")]
    told = [e for row in table.splitlines()[2:] for e in re.findall(r"`([^`]*msg[^`]*)`", row.replace("\\|", "|"))]
    message = {
        "pose": {"position": {"z": 2.5}}, "status": 2, "count": 7, "speed": 1.5, "position": [0.5], "name": ["a", "b"],
        "ranges": [1.5, "Infinity", "NaN", 0.25], "goal": {}, "frame_id": "map", "id": 7,
    }  # fmt: skip
    values = {e: Projection({"it": e})(message) for e in told}
    assert {e for e, (_, failed) in values.items() if failed} == {"msg.speed * 2"}
    assert values["msg.ranges.exists(r, r != 'NaN' && double(r) < 0.5)"][0] == {"it": True}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_named_in_the_documents_are_there(path: Path) -> None:
    text = path.read_text()
    links = [link for link in re.findall(r"\]\(([^)#]+)", text) if "://" not in link]
    scripts = re.findall(r"\./scripts/[\w-]+", text)
    missing = [name for name in links if not (path.parent / name).exists()]
    missing += [name for name in scripts if not (ROOT / name).exists()]
    assert missing == []


def test_every_setting_is_told() -> None:
    text = (ROOT / "docs" / "operations.md").read_text()
    assert [name for name in Settings.model_fields if f"`ORACLE_{name.upper()}`" not in text] == []


def test_every_key_of_a_spec_is_told() -> None:
    text = (ROOT / "docs" / "spec.md").read_text()
    models = (OrderingModel, TopicModel, ServiceModel, PropertyModel, RetentionModel, SpecModel)
    keys = {name for model in models for name in model.model_fields}
    assert {key for key in keys if not re.search(rf"`{key}`|\b{key}:", text)} == set()


def test_the_architecture_has_every_module_and_no_other() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text()
    told = Counter(re.findall(r"`(?:[\w/]+/)?(\w+\.py)`", text))
    here = ("oracle_server", "adapters/common/oracle_adapter", "adapters/ros1/oracle_ros1")
    there = Counter(path.name for package in here for path in (ROOT / package).rglob("*.py"))
    assert [name for name in there - told if not name.startswith("__")] == [], "not told, or only one of two"
    like_ros1 = {path.name for path in (ROOT / "adapters/ros2/oracle_ros2").glob("*.py")}
    assert [name for name in like_ros1 | there.keys() if name not in told and not name.startswith("__")] == []
    assert [name for name in told if name not in like_ros1 | there.keys()] == []
