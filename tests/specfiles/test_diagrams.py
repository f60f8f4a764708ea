"""Specs that `import --diagram` writes: the machine of a diagram, and what is refused of it with its line."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
import yaml

from oracle_server.core.derived.definition import Definition
from oracle_server.core.machines.drawing import mermaid
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.diagrams.read import DiagramError
from oracle_server.specfiles.diagrams.write import import_diagram
from oracle_server.specfiles.load import parse_spec

TYPES = Types((), {})
MERMAID = """
stateDiagram-v2
    direction LR
    %% a door
    [*] --> Closed
    Closed --> Open: push
    Open --> Closed: speed > 0.5
    note right of Open
        it --> stands
    end note
    Open --> Broken: hit hard!
    Broken --> [*]
"""
DOT = """
digraph door {
  rankdir="LR"; node [shape=circle];
  init [shape=point];
  init -> Closed
  Closed -> Open [label="push"];   // opens
  Open -> Closed [label="speed > 0.5", color=red]
  Open -> Broken [label = "hit hard!"]
}
"""


def imported(tmp_path: Path, text: str) -> tuple[Definition, str]:
    source, out = tmp_path / "door.txt", tmp_path / "door.yaml"
    source.write_text(text)
    found = import_diagram(source, out, TYPES)
    assert not found.refused, found.findings
    assert not found.judges
    written = out.read_text()
    return parse_spec(written, "door.yaml").spec.derive[0], written


def rows(tmp_path: Path, text: str) -> dict[str, dict[str, str]]:
    """The events of each state, and where these lead, as the spec that is written has them."""
    _, written = imported(tmp_path, text)
    states: dict[str, dict[str, str]] = yaml.safe_load(written)["derive"]["machine"]["states"]
    return states


@pytest.mark.parametrize("text", [MERMAID, DOT])
def test_both_languages_say_the_same(tmp_path: Path, text: str) -> None:
    definition, written = imported(tmp_path, text)
    assert list(mermaid(definition)) == [
        "stateDiagram-v2",
        "    [*] --> Closed",
        "    Closed --> Open: on_push",
        "    Closed --> Closed: on_speed_0_5",
        "    Open --> Closed: on_speed_0_5",
        "    Open --> Broken: on_hit_hard",
        "    Broken --> Broken: on_speed_0_5",
        "    %% an event that a state has not leads to error",
    ]
    assert 'on_speed_0_5: "{speed > 0.5}"' in written
    assert 'on_hit_hard: "{event: \\"hit hard!\\"}"' in written
    assert written.count("TODO: say in CEL") == 2


def test_a_comparison_changes_nothing_where_no_arrow_has_it(tmp_path: Path) -> None:
    text = (
        "stateDiagram-v2\n[*] --> Idle\nIdle --> Heat: t < 18\nHeat --> Idle: t > 22 && door == 0\nIdle --> Off: stop"
    )
    assert rows(tmp_path, text) == {
        "Idle": {"on_t_18": "Heat", "on_stop": "Off", "on_t_22_door_0": "Idle"},
        "Heat": {"on_t_22_door_0": "Idle", "on_t_18": "Heat"},
        "Off": {"on_t_18": "Off", "on_t_22_door_0": "Off"},
    }


def test_labels_with_quotes_are_texts_that_check_reads(tmp_path: Path) -> None:
    _, written = imported(tmp_path, 'stateDiagram-v2\nA --> B: say "hi"\nB --> A: it\'s\\back')
    assert """on_say_hi: "{event: 'say \\"hi\\"'}\"""" in written
    assert 'on_it_s_back: "{event: \\"it\'s\\\\back\\"}"' in written


def test_arrows_without_labels_follow_a_signal(tmp_path: Path) -> None:
    definition, _ = imported(tmp_path, "digraph { IDLE -> AUTO -> IDLE; 3 -> IDLE; AUTO -> 3 }")
    assert definition.op == "follows"
    assert [line.strip() for line in mermaid(definition)] == [
        "stateDiagram-v2",
        'state "3" as s2',
        "IDLE --> AUTO",
        "AUTO --> IDLE",
        "AUTO --> s2",
        "s2 --> IDLE",
        "%% any other change is error",
    ]


def test_what_check_draws_is_read_again(tmp_path: Path) -> None:
    drawn = "\n".join(mermaid(imported(tmp_path, MERMAID)[0]))
    again, _ = imported(tmp_path, drawn)
    first, _ = imported(tmp_path, MERMAID)
    assert again.table is not None
    assert first.table is not None
    assert (again.table.names, again.table.rows, again.table.start) == (
        first.table.names, first.table.rows, first.table.start,
    )  # fmt: skip


def test_classes_of_states_are_no_labels(tmp_path: Path) -> None:
    arrows = "[*] --> Off:::cold\nOff --> On:::hot: start\nOn:::hot --> Off : stop"
    assert rows(tmp_path, f"stateDiagram-v2\n{arrows}\nstate On:::hot\nOff:::cold") == {
        "Off": {"on_start": "On"},
        "On": {"on_stop": "Off"},
    }


def test_a_labelled_arrow_to_the_end_leads_to_a_final_state(tmp_path: Path) -> None:
    text = "stateDiagram-v2\n[*] --> Idle\nIdle --> [*]: stop\nIdle --> Run: start\nRun --> Idle: stop\nRun --> [*]"
    wanted = {"Idle": {"on_stop": "end", "on_start": "Run"}, "Run": {"on_stop": "Idle"}, "end": {}}
    assert rows(tmp_path, text) == wanted
    text = "digraph { out [shape=point]; A -> out [label=stop]; A -> end [label=go]; end -> out }"
    assert rows(tmp_path, text) == {"A": {"on_stop": "end_2", "on_go": "end"}, "end": {}, "end_2": {}}


def test_states_may_be_called_as_what_mermaid_is_told(tmp_path: Path) -> None:
    words = ("hide", "scale", "style", "class", "classDef", "direction", "accTitle", "state", "note")
    told = "direction LR\nhide empty description\nscale 350 width\nclass hide hot\nstyle hide fill:red"
    arrows = "\n".join(f"{word} --> idle: on {word}\n{word} : a word" for word in words)
    found = rows(tmp_path, f"stateDiagram-v2\n{told}\naccTitle: a --> b\n{arrows}\nidle --> hide: x")
    assert found == {**{word: {f"on_on_{word}": "idle"} for word in words}, "idle": {"on_x": "hide"}}


def test_comments_behind_arrows_are_no_labels(tmp_path: Path) -> None:
    text = "stateDiagram-v2 %% a door\nA --> B: go; %% later\nB --> A: at 5%%\n%% B --> C: never"
    _, written = imported(tmp_path, text)
    assert 'on_go: "{event: go}"' in written
    assert 'on_at_5: "{event: \\"at 5%%\\"}"' in written


def test_a_note_of_one_line_ends_with_it(tmp_path: Path) -> None:
    text = "stateDiagram-v2\nA --> B: go\nnote right of A: a --> b\nB --> A: stop"
    assert rows(tmp_path, text) == {"A": {"on_go": "B"}, "B": {"on_stop": "A"}}


def test_ports_of_dot_are_no_part_of_states(tmp_path: Path) -> None:
    arrows = 'Idle:e -> "Run":w:n [label=start]; Run : "p q" -> Idle:s->Run:w [label=stop] "a:b" -> Idle [label=x]'
    assert rows(tmp_path, f"digraph {{ {arrows} }}") == {
        "Idle": {"on_start": "Run", "on_stop": "Run"}, "Run": {"on_stop": "Idle"}, "a:b": {"on_x": "Idle"},
    }  # fmt: skip


@pytest.mark.parametrize(
    "head",
    [
        "digraph fsm\n{",
        "/* a\n machine */ digraph fsm {",
        "// a machine\ndigraph fsm // of two\n{",
        'strict Digraph /* x */ "a b"\n# 1\n{',
        "digraph{",
        'digraph "http://a" {',
        "```dot\nstrict digraph {",
    ],
)
def test_dot_may_begin_on_several_lines(tmp_path: Path, head: str) -> None:
    assert rows(tmp_path, f"{head} A -> B [label=go] }}") == {"A": {"on_go": "B"}, "B": {}}


def test_comparisons_that_are_joined_are_a_formula(tmp_path: Path) -> None:
    _, written = imported(
        tmp_path, 'digraph { 0 -> 1 [label="(x >= 1) && x<=1.5 and y != -2"]; 1 -> 0 [label="x > 1 && go"] }'
    )
    assert '"{x >= 1} and {x <= 1.5} and {y != -2}"' in written
    assert '"{event: \\"x > 1 && go\\"}"' in written
    assert [line.split(":")[0].strip() for line in written.splitlines() if "TODO: say in CEL" in line] == [
        "x", "y", "event",
    ]  # fmt: skip


@pytest.mark.parametrize("unclosed", ['\\" ', "/* "])
def test_what_is_never_closed_takes_no_minutes(tmp_path: Path, unclosed: str) -> None:
    source = tmp_path / "door.dot"
    source.write_text("digraph { " + unclosed * 60_000)
    begun = time.monotonic()
    with pytest.raises(DiagramError, match="a `}` is missing"):
        import_diagram(source, None, TYPES)
    assert time.monotonic() - begun < 5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('stateDiagram-v2\nA --> B: say "it\'s"\nB --> A: x', ':2: the label "say \\"it\'s\\"" has both kinds of'),
        ("stateDiagram-v2\nstate A {\nB --> C\n}", ":2: states within states"),
        ("stateDiagram-v2\nA --> B: x\nA --> C: x", ":3: `x` leads from `A` to `C` here, and in line 2 to `B`"),
        ("stateDiagram-v2\nA --> B: x\nB --> A", ":3: the arrow to `A` has no label"),
        ("stateDiagram-v2\n[*] --> A\n[*] --> B", ":3: it begins in `A` already"),
        ("stateDiagram-v2\nA is big", ":2: `A is big` is not understood"),
        ("stateDiagram-v2\nA --> B: x\nA B --> C: x", ":3: `A B --> C: x` is not understood as an arrow"),
        ("stateDiagram-v2\nA -->|x| B", ":2: `A -->|x| B` is not understood as an arrow"),
        ("stateDiagram-v2\nA: x --> B", ":2: `A: x --> B` is not understood as an arrow"),
        ("stateDiagram-v2\nstyle A --> B", ":2: `style A --> B` is not understood as an arrow"),
        ("stateDiagram-v2\nA-->B-->C: x", ":2: `A-->B-->C: x` is not understood as an arrow"),
        ("stateDiagram-v2\nA --> B: x; B --> A: y", ":2: `A --> B: x; B --> A: y` is not understood as an arrow"),
        ("stateDiagram-v2\nA --> B:::", ":2: `A --> B:::` is not understood as an arrow"),
        ("stateDiagram-v2\n[*] --> [*]: x", ":2: `[*] --> [*]: x` is not understood as an arrow"),
        ("stateDiagram-v2\nA --> B\nnote left of A\nB --> A", ":3: this note has no end"),
        ("stateDiagram-v2\nA->B: x", ":2: `A->B: x` is not understood"),
        (
            "digraph {\nA -> B [label=<go <B>now</B>>] }",
            ':2: a label in HTML is not read: write it in quotes, as `label="',
        ),
        ("digraph {\nA -> B:; }", ":2: `;` is not expected here"),
        ("sequenceDiagram\nA --> B", "no state diagram"),
        ("stateDiagram-v2\n", "no arrow between states"),
        ("graph { A -- B }", ":1: a `graph` has no directions"),
        ("digraph { A -> B", ":1: a `}` is missing"),
        ("digraph {\nsubgraph x { A -> B } }", ":2: graphs within graphs"),
        ("digraph {\nA -> ;}", ":2: `;` is not expected here"),
    ],
)
def test_what_is_refused_is_told_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    source = tmp_path / "door.mmd"
    source.write_text(text)
    with pytest.raises(DiagramError) as caught:
        import_diagram(source, tmp_path / "out.yaml", TYPES)
    assert message in str(caught.value)
