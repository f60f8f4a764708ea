"""The recipes of docs/cookbook.md: each spec is sound, and judges its two recordings as the text beside them says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import load_spec

TEXT = (Path(__file__).parents[1] / "docs" / "cookbook.md").read_text()
RECIPES = [pytest.param(part, id=part.partition("\n")[0]) for part in re.split(r"^## ", TEXT, flags=re.MULTILINE)[1:]]


def test_all_that_is_often_wanted_is_there() -> None:
    assert [recipe.id for recipe in RECIPES] == [
        "Liveness", "Response within", "Has lasted", "Mutual exclusion", "Debounce", "Precedence", "Rate",
        "Window of time", "Until", "One after the other", "Heartbeats of each", "E-stop", "Guard by a state",
        "Mode changes", "Limit by another stream", "Tilt and heading",
    ]  # fmt: skip


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_recipe_judges_its_recordings_as_it_says(recipe: str, tmp_path: Path) -> None:
    (spec,) = re.findall(r"```yaml\n(.*?)```", recipe, re.DOTALL)
    recordings = re.findall(
        r"^This (satisfies|violates) ([^\n]*)\n\n```jsonl\n(.*?)```", recipe, re.DOTALL | re.MULTILINE
    )
    assert [word for word, *_ in recordings] == ["satisfies", "violates"]
    path = tmp_path / "r.yaml"
    path.write_text(spec)
    loaded = load_spec(path, types=Types((), {}))
    assert loaded.warnings == ()
    for word, text, lines in recordings:
        recording = tmp_path / f"{word}.jsonl"
        recording.write_text(lines)
        replay = Replay(loaded.spec, open_recording(recording, loaded.spec))
        judged = list(replay)
        said = {v.property for item in judged for v in item.verdicts if v.outcome.value.startswith("currently")}
        assert said == {p.id for p in loaded.spec.properties}
        assert replay.events == len(lines.splitlines())
        violated = {name for name, state in replay.states().items() if state["violations"]}
        assert violated == (set(re.findall(r"`(\w+)`", text)) if word == "violates" else set())
        assert violated or word == "satisfies"
