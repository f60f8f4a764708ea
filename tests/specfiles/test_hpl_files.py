"""`import --hpl`: what is written of a whole file, its names, and files that can't be read."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from oracle_server.core.signals import Projection
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.hpl.tree import HplError
from oracle_server.specfiles.hpl.write import import_hpl
from oracle_server.specfiles.load import parse_spec
from tests.specfiles.test_hpl import imported, patterns
from tests.whole.harness import run

ROOT = Path(__file__).parents[2]
CORPUS = ROOT / "tests" / "corpus" / "hpl"
SECOND = 10**9
Message = Mapping[str, Any]

few = settings(max_examples=30, deadline=None)


def test_a_file_with_all_of_it(tmp_path: Path) -> None:
    done = run("import", "--hpl", CORPUS / "rover.hpl", "-o", tmp_path / "rover.yaml")
    assert "the pattern of rising, the pattern of squares, the pattern of pressed" in done.stderr
    spec = parse_spec((tmp_path / "rover.yaml").read_text(), "rover.yaml").spec
    said = {prop.id: prop for prop in spec.properties}
    assert spec.id == "rover"
    assert said["speed_limit"].description == "Speed limit. The rover is never faster than 1 m/s"
    assert said["battery_kept"].text.startswith(
        "forall[S_id]. after ({topic: /mission/start, id: *S_id} and not pre (not"
    )
    assert said["all_buttons"].text.startswith("until /shutdown: no /joy")
    assert [prop.time for prop in spec.properties[:4]] == ["steps", "seconds", "steps", "seconds"]


def test_the_page_shows_what_is_written(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "from-haros.md").read_text()
    source, shown = re.search(r"```\n(.*?)```", page, re.DOTALL), re.search(r"```yaml\n(.*?)```", page, re.DOTALL)
    assert source
    assert shown
    (tmp_path / "rover.hpl").write_text(source[1])
    import_hpl(tmp_path / "rover.hpl", tmp_path / "rover.yaml", Types(()))
    written = (tmp_path / "rover.yaml").read_text()
    assert written[written.index("id: rover") :] == shown[1]


def test_a_text_is_called_as_it_is_said(tmp_path: Path) -> None:
    (tmp_path / "it.hpl").write_text('globally: no /note {data = "é✓"}\n')
    import_hpl(tmp_path / "it.hpl", tmp_path / "it.yaml", Types(()))
    spec = parse_spec((tmp_path / "it.yaml").read_text(), "it.yaml").spec
    assert spec.streams[0].signals == {"data = 'é✓'": 'msg.data == "é✓"'}
    assert spec.properties[0].text == "globally: no /note {\"data = 'é✓'\"}"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "no property"),
        ("some /b", "1:1: a property begins with its scope"),
        ("globally no /b", "1:10: a scope ends with `:`"),
        ("globally: no /b {}", "1:18: a value is expected"),
        ("globally: no /b {x < 1, y}", "1:23: a predicate ends"),
        ("globally: no /b {x > 1\n", "2:1: a predicate ends"),
        ("globally: no /b {x in [0, 1]}", "`to` is expected"),
        ("globally: no /b {x and not}", "a value is expected"),
        ("globally: /a leads /b", "1:14: a pattern is"),
        ("globally: no /b within 5", "a time is in `s` or `ms`"),
        ("globally: no /b within 0 s", "1:24: a time is longer than 0"),
        ("globally: no /b within 1e-99999 s", "a time is longer than 0"),
        ("globally: no /b within 1e99999 s", "a time is longer than 0"),
        ("globally: no /b\n# title: it\nglobally: no /b", "2:10: behind `# title:`"),
        ("globally: no (/a or)", "1:20: a topic is expected"),
        ("globally: no /b {" + "(" * 100 + "x", "within each other"),
        ("globally: no /b {" + "not " * 100 + "x", "within each other"),
        ("globally: no /b {" + "-" * 5000 + "x", "within each other"),
        ("globally: no /b {" + "a[" * 5000 + "x", "within each other"),
        ("globally: no /b {x in " + "[0 to " * 5000, "within each other"),
        ("globally: no /b {" + "x + " * 2000 + "x > 1}", "at most 200 operators"),
        ("globally: no /b\n" * 1001, "1,000 properties"),
    ],
)
def test_a_file_of_another_shape_is_refused_in_a_line(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(HplError) as raised:
        imported(tmp_path, text)
    assert told in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("data", [b"\xff", b" " * 1_000_001])
def test_bytes_that_are_no_text(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "it.hpl").write_bytes(data)
    with pytest.raises(HplError):
        import_hpl(tmp_path / "it.hpl", None, Types(()))


def test_texts_of_others_stay_where_they_are(tmp_path: Path) -> None:
    text = (
        '# description: "it\'s: \\"x\\" # y\u2028guards: [/x]"\n# id: a\nglobally: no /b {s = "a\'b: \\\\ # \u00e9"}\n'
    )
    text += "# id: a\nglobally: no /b"
    spec, _ = imported(tmp_path, text)
    first, second = parse_spec(spec, "it.yaml").spec.properties
    assert (first.id, second.id) == ("a", "a_2")
    assert not first.guards
    project = Projection(dict(parse_spec(spec, "it.yaml").spec.streams[0].signals or {}))
    (value,) = project({"s": "a'b: \\ # \u00e9"})[0].values()
    assert value is True


def test_names_that_are_words_here(tmp_path: Path) -> None:
    text = (
        "globally: no /b {once}\nglobally: no /b {kind}\nglobally: no /b {todo}\nglobally: /b as S causes /c {P = @S.A}"
    )
    spec, told = imported(tmp_path, text)
    assert told.todos == ("the pattern of p4",)
    assert list(patterns(spec).values())[:3] == [
        'globally: no /b {"once"}', 'globally: no /b {"msg.kind"}', 'globally: no /b {"msg.todo"}',
    ]  # fmt: skip


def test_the_same_text_of_two_messages_is_two_signals(tmp_path: Path) -> None:
    text = "globally: /b as A causes /c {x > @A.y}\nglobally: /a as B causes /c as A {x > @A.y}"
    spec, told = imported(tmp_path, text)
    assert not told.todos
    assert "'x > @A.y': 'msg.x > msg.y'" in spec


def test_a_predicate_too_long_for_a_name_is_a_signal_all_the_same(tmp_path: Path) -> None:
    long = " or ".join(f"field_{n} > {n}" for n in range(60))
    spec, told = imported(tmp_path, f"globally: no /b {{{long} or x}}\nglobally: no /b {{{long} or y}}")
    assert not told.todos
    (signals,) = [stream.signals for stream in parse_spec(spec, "it.yaml").spec.streams]
    assert len(signals or ()) == 2
