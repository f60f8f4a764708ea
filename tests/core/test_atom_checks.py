"""What is left to test of an atom, made ready for a stream, is what the formula says."""

from __future__ import annotations

from itertools import product

import pytest

from oracle_server.core.atoms import meets, specialise
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.tree import Atom, Scalar

VALUES: list[Scalar] = ["7", "", "true", 7, 7.0, 7.5, 0, -0.0, 1, 1.0, True, False, 2**63, 2.0**63]
WRITTEN = ['"7"', '""', '"true"', "7", "7.5", "0", "1", "true", "false", "9223372036854775808"]
ORDERS = ["<", "<=", ">", ">="]
CONSTRAINTS = [f"v: {text}" for text in WRITTEN] + [
    f"v {op} {text}" for op, text in product(["!=", *ORDERS], WRITTEN) if op == "!=" or text[0] not in '"tf'
]


@pytest.mark.parametrize("text", CONSTRAINTS)
def test_a_check_is_what_its_constraint_says(text: str) -> None:
    atom = parse_formula("{" + text + "}")
    assert isinstance(atom, Atom)
    (test,) = specialise([atom], {}, lambda _: True)
    for value in VALUES:
        assert (test.match({"v": value}) is not None) == meets(atom.constraints[0], value), value
    assert test.match({}) is None
