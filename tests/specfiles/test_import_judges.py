"""What is imported judges as the original oracle, or is unknown: never another verdict."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.rosmonitoring.config import read_config
from oracle_server.specfiles.rosmonitoring.formulas import UnreadableFormulaError, read_formula
from tests.specfiles.against_original import Compared, compare, random_traces

SHAPES = yaml.safe_load((Path(__file__).parents[1] / "corpus" / "rosmonitoring" / "shapes.yaml").read_text())
TRACES = 8


@pytest.mark.parametrize("name", SHAPES["shapes"])
def test_a_shape_is_judged_as_by_its_oracle_or_unknown(tmp_path: Path, name: str) -> None:
    shape = SHAPES["shapes"][name]
    found = compared(tmp_path, name, shape, seed=1, traces=TRACES)
    assert found.different is None, found.text
    whole = not found.todos and not found.external
    became = {"todo": found.todos > 0, "external": found.external, "same": whole, "fails": whole}
    assert became[shape["expect"]], found.text
    if shape["expect"] == "same":
        assert found.values == {True, False}, (found.values, found.text)
        assert found.same > found.unknown
    if shape["expect"] == "fails":
        assert (found.same, found.unknown > 0, found.values) == (0, True, set())
    if shape["expect"] == "todo":
        assert (found.same, found.unknown > 0) == (0, True)
        assert any("still to be written" in str(w) for w in parse_spec(found.text, "x").warnings)
    if shape["expect"] == "external":
        assert parse_spec(found.text, "x").spec.properties[0].external is not None


@pytest.mark.parametrize(
    ("kind", "operation"),
    [(kind, python) for kind in ("Vector3", "odd", "numeral") for python in SHAPES["operations"]]
    + [("LaserScan", python) for python in SHAPES["lists"]],
)
def test_an_operation_that_fails_in_python_is_unknown(tmp_path: Path, kind: str, operation: str) -> None:
    """Also where its counterpart has a value: there a division by zero is infinite, and a text read as a number."""
    types = {"Vector3": "geometry_msgs/Vector3", "LaserScan": "sensor_msgs/LaserScan"}
    shape = {
        "module": "import math\nPROPERTY = '{p}'\npredicates = dict(time=0, p=False)\n"
        f"def abstract_message(message):\n    predicates['p'] = {operation}\n",
        "fields": dict.fromkeys("xyz", kind),
        "types": {"chatter": types.get(kind, "")},
        "odd": True,
    }
    found = compared(tmp_path, "operation", shape, seed=1, traces=16, length=2)
    assert found.different is None, (found.text, found.different)
    assert not found.todos
    assert found.same > 0, found.text


def compared(folder: Path, name: str, shape: dict[str, Any], *, seed: int, traces: int, length: int = 12) -> Compared:
    """A shape's module written, imported, and compared with the original."""
    module = folder / f"{name}.py"
    module.write_text(SHAPES["start"] + shape["module"] + shape.get("end", SHAPES["end"]))
    types = shape.get("types", {})
    monitor = {"id": "monitor", "oracle": {"port": 8080}} | {
        key: [
            {"name": n, "action": "log", "type": types.get(n, "")}
            for n in shape.get(key, ["chatter"] if key == "topics" else [])
        ]
        for key in ("topics", "services")
    }
    config = read_config({"monitors": [{"monitor": monitor}]}, "made")
    fields = shape.get("fields", {"data": "number"})
    kinds = {key: shape.get(key, False) for key in ("optional", "odd")}
    made = random_traces(module, config, seed, traces, length, fields=fields, **kinds)
    return compare(config, module, list(made))


@pytest.mark.parametrize("text", ["{a} -> {b} -> {c}", "not not {p}", "{a} and not once{b}", "{a} since {b} since {c}"])
def test_what_reelay_reads_only_in_part_is_not_taken_for_what_it_judged(text: str) -> None:
    with pytest.raises(UnreadableFormulaError, match="only in part"):
        read_formula(text)


def test_a_todo_is_unknown_at_every_event(tmp_path: Path) -> None:
    """Also at streams whose messages do not set the predicate, and before those that do."""
    shape = {
        "module": "PROPERTY = 'not {far} and once{near}'\npredicates = {'far': False, 'near': True}\n"
        "def abstract_message(message):\n    if message.get('topic') == 'a':\n"
        "        predicates['far'] = hash(message.get('data')) > 3\n    return predicates\n",
        "end": "",
        "topics": ["a", "b"],
        "services": ["s"],
    }
    found = compared(tmp_path, "far", shape, seed=2, traces=4)
    assert (found.same, found.unknown) == (0, 48)
