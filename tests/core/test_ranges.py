"""What a signal's values can meet, of many constraints as of few."""

from __future__ import annotations

from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracle_server.core import ranges
from oracle_server.core.atoms import meets
from oracle_server.core.formula.tree import Any as AnyValue
from oracle_server.core.formula.tree import Constraint, Limit, Ref, Signal
from oracle_server.core.ranges import ANYTHING, BOOLEAN, NUMBER, TEXT, Range

WHOLE = Range(whole=(0, 4))
WRITTEN = Range(values=("a", 1, True, 2.5))
VALUES = st.sampled_from(
    [0, 1, 1.0, 2, 2.5, 3, -7, True, False, "a", "1", AnyValue.ANY, Ref("x"), Signal("w"), Limit("x")]
)
CONSTRAINTS = st.builds(
    lambda op, value: Constraint("v", op if not isinstance(value, AnyValue | Ref) else "==", value),
    st.sampled_from(["==", "!=", "<", "<=", ">", ">="]),
    VALUES,
)


@given(st.sampled_from([ANYTHING, TEXT, NUMBER, BOOLEAN, WHOLE, WRITTEN]), st.lists(CONSTRAINTS, max_size=6))
def test_a_range_meets_what_one_of_its_values_meets(found: Range, constraints: list[Constraint]) -> None:
    tried = [value for value in found.telling(constraints) if all(meets(c, value) for c in constraints)]
    assert found.meets(constraints) is bool(tried)


MANY = 300
ABOVE = [Constraint("v", ">", i) for i in range(MANY)]


@pytest.mark.parametrize(
    "constraints",
    [
        ABOVE,
        [*ABOVE, *(Constraint("v", "<=", 2 * MANY + i) for i in range(MANY))],
        [*ABOVE, *(Constraint("v", "!=", 2 * MANY + i) for i in range(MANY))],
        [*(Constraint("v", "<", Signal(f"w{i}")) for i in range(MANY)), *ABOVE],
    ],
)
@pytest.mark.parametrize("found", [NUMBER, ANYTHING, Range(whole=(0, 2**32))])
def test_the_work_grows_with_the_constraints_and_not_with_their_square(
    monkeypatch: pytest.MonkeyPatch, found: Range, constraints: list[Constraint]
) -> None:
    """A client that stores a spec with an atom of thousands would have a server for itself."""
    asked = count()
    monkeypatch.setattr(ranges, "meets", lambda c, v: (next(asked), meets(c, v))[1])
    assert found.meets(constraints)
    assert next(asked) < 20 * MANY
