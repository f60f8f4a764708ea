"""Specs that `import --diagram` writes: the machine of a diagram, and what is refused of it with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

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


@pytest.mark.parametrize("text", [MERMAID, DOT])
def test_both_languages_say_the_same(tmp_path: Path, text: str) -> None:
    definition, written = imported(tmp_path, text)
    assert list(mermaid(definition)) == [
        "stateDiagram-v2",
        "    [*] --> Closed",
        "    Closed --> Open: on_push",
        "    Open --> Closed: on_speed_0_5",
        "    Open --> Broken: on_hit_hard",
        "    %% an event that a state has not leads to error",
    ]
    assert 'on_speed_0_5: "{speed > 0.5}"' in written
    assert 'on_hit_hard: "{event: \\"hit hard!\\"}"' in written
    assert written.count("TODO: say in CEL") == 2


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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('stateDiagram-v2\nA --> B: say "it\'s"\nB --> A: x', ':2: the label "say \\"it\'s\\"" has both kinds of'),
        ("stateDiagram-v2\nstate A {\nB --> C\n}", ":2: states within states"),
        ("stateDiagram-v2\nA --> B: x\nA --> C: x", ":3: `x` leads from `A` to `C` here, and in line 2 to `B`"),
        ("stateDiagram-v2\nA --> B: x\nB --> A", ":3: the arrow to `A` has no label"),
        ("stateDiagram-v2\n[*] --> A\n[*] --> B", ":3: it begins in `A` already"),
        ("stateDiagram-v2\nA is big", ":2: `A is big` is not understood"),
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
