"""What `check` says of one atom over a typed field, against all messages of the type, or very many of them."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import pytest

from oracle_server.core.atoms import meets
from oracle_server.core.errors import Finding
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.tree import Atom
from oracle_server.core.plan import plan
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import parse_spec
from tests.rostypes.making import package

WANTED = (
    *("true", "false", "True", "on", '"1"', '"true"', "NaN", "inf", '"-Infinity"', '""', "IDLE"),
    *("0", "1", "-1", "2.5", "127", "128", "-128", "-129", "255", "255.5", "256", "300", "1e300"),
)
TEXTS = ("", "on", "1", "true", "True", "IDLE", "inf", "a\nb", "…", "NaNs")
WHOLE = {"int8": range(-128, 128), "uint8": range(256)}
KINDS = ("bool", "string", "wstring", "float32", "float64", "byte", "char", *WHOLE)


def values(kind: str, random: Random) -> Sequence[Any]:
    """All values of a field, as adapters send them, or many where there are too many."""
    if kind == "bool":
        return (True, False)
    if "string" in kind:
        return TEXTS
    if "float" in kind:
        some = [struct.unpack("d", random.randbytes(8))[0] for _ in range(50)]
        return [v for v in (*some, 0.0, 1.0, -1.0, 2.5, 127.0, 1e300, -1e300) if math.isfinite(v)]
    return WHOLE[{"byte": "uint8", "char": "uint8"}.get(kind, kind)]


def findings(kind: str, signals: str, atom: str, types: Types) -> tuple[Finding, ...]:
    stream = f"{{topic: /a, type: x_msgs/msg/X{signals}}}"
    text = f"id: x\nstreams:\n  - {stream}\nproperties:\n  - id: p\n    formula: 'not {atom}'\n"
    return parse_spec(text, "x", types=types).warnings


@pytest.mark.parametrize("kind", KINDS)
def test_an_atom_is_never_met_or_always_where_it_is_said_and_only_there(kind: str, tmp_path: Path) -> None:
    package(tmp_path / "x_msgs", {"msg/X.msg": f"{kind} f\n"})
    types, random = Types([tmp_path], {}), Random(kind)
    those = values(kind, random)
    exact = kind == "bool" or kind in WHOLE
    told = 0
    for number in range(60):
        signals = ", signals: {f: msg.f}" if number % 2 else ""
        wanted = [random.choice(WANTED) for _ in range(random.choice((1, 1, 2)))]
        marks = [random.choice((":", "!=", "<", "<=", ">", ">=")) for _ in wanted]
        pairs = [
            (m if w[0] in "-0123456789" or m in (":", "!=") else ":", w) for m, w in zip(marks, wanted, strict=True)
        ]
        text = (
            "{" + ", ".join(f"f{mark} {value}" if mark == ":" else f"f {mark} {value}" for mark, value in pairs) + "}"
        )
        atom = parse_formula(text)
        assert isinstance(atom, Atom)
        found = [w.message for w in findings(kind, signals, text, types)]
        never = any("never met" in message or "never holds" in message for message in found)
        always = any("it fails at every event" in message for message in found)
        met = [all(meets(c, value) for c in atom.constraints) for value in those]
        assert not (never and any(met)), (text, found)
        assert not (always and not all(met)), (text, found)
        if exact:
            assert never is not any(met), (text, found)
            assert always is all(met), (text, found)
        told += never or always
    assert told > 10


def test_a_typed_field_is_a_signal_of_its_kind(tmp_path: Path) -> None:
    package(tmp_path / "x_msgs", {"msg/X.msg": "bool f\n"})
    text = "id: x\nstreams: [{topic: /a, type: x_msgs/msg/X}]\nproperties: [{id: p, formula: 'not {f}'}]\n"
    loaded = parse_spec(text, "x", types=Types([tmp_path], {}))
    assert loaded.warnings == ()
    (stream,) = plan(loaded.spec).streams.values()
    assert stream.project({"f": True}) == ({"f": True}, frozenset())
