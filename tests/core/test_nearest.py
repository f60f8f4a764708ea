"""The names that may have been meant, and what looking for them may take."""

from __future__ import annotations

import difflib
import random

import pytest

from oracle_server.core.nearest import near, nearest

KNOWN = ("fan_speed", "fan_state", "heating")


def test_the_likeliest_names_are_told() -> None:
    assert near("fan_sped", KNOWN) == ["fan_speed"]
    assert near("FAN_ST", KNOWN) == ["fan_state"]
    assert nearest("fan_s", KNOWN, 0.5) == "did you mean `fan_state` or `fan_speed`?"
    assert nearest("door", KNOWN) == ""


def test_a_name_is_found_among_thousands_that_are_much_alike() -> None:
    known = [f"robot_{i}_joint_velocity" for i in range(5_000)]
    assert near("robot_321_joint_velocty", known)[0] == "robot_321_joint_velocity"


def test_many_names_of_the_same_characters_are_not_all_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who asks for a property that there is not had the server look for 3 s, while no decision was made."""
    compared: list[float] = []

    class Counting(difflib.SequenceMatcher[str]):
        def ratio(self) -> float:
            compared.append(super().ratio())
            return compared[-1]

    monkeypatch.setattr(difflib, "SequenceMatcher", Counting)
    chance = random.Random(1)
    known = ["".join(chance.choice("ab") for _ in range(60)) for _ in range(1_000)]
    assert near(known[0][:50], known)
    assert 0 < len(compared) < 20
