from __future__ import annotations

from typing import Any

import pytest
from oracle_adapter import Answer, should_pass

ALLOW = Answer("decision", "allow")
DENY = Answer("decision", "deny", denied_by=("p",))


@pytest.mark.parametrize(
    ("answer", "policy", "passed"),
    [
        (ALLOW, "deny", True),
        (ALLOW, "pass", True),
        (DENY, "deny", False),
        (DENY, "pass", False),
        (Answer("timeout"), "deny", False),
        (Answer("timeout"), "pass", True),
        (Answer("unavailable"), "deny", False),
        (Answer("unavailable"), "pass", True),
        (Answer("decision", None), "pass", False),
    ],
)
def test_a_decision_rules_and_else_the_policy(answer: Answer, policy: Any, passed: bool) -> None:
    assert should_pass(answer, policy) == (passed, answer.why)


def test_an_unknown_policy_is_refused() -> None:
    with pytest.raises(ValueError, match="'forward'"):
        should_pass(ALLOW, "forward")  # type: ignore[arg-type]
