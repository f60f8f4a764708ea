"""A short campaign; a long one is run by hand."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests.chaos.campaign import KINDS, Kind, judged, run_round
from tests.chaos.disk import Unmountable
from tests.chaos.link import Frame
from tests.chaos.runs import TRIO, uninterrupted


@pytest.mark.parametrize("kind", KINDS[1:], ids=lambda kind: kind.name)
async def test_nothing_acked_is_lost_or_judged_twice_or_otherwise(
    kind: Kind, trace: list[Frame], tmp_path: Path, chance: random.Random, known: dict[str, list[Frame]]
) -> None:
    expected = await uninterrupted(TRIO, trace, tmp_path, known)
    folder = tmp_path / "round"
    folder.mkdir()
    try:
        count = await run_round(kind, trace, expected, folder, chance, kills=2)
    except Unmountable as error:
        pytest.skip(str(error))
    assert count.kills >= 1
    assert count.acked == len(trace)
    assert (count.lost, count.twice, count.different) == (0, 0, 0)
    assert (count.late > 0) == kind.revises


def test_the_campaign_sees_what_is_lost_twice_and_different() -> None:
    records: list[Frame] = [
        {"n": n, "monitor": "m", "seq": n, "property": "p", "outcome": "true", "decision": "allow", "degraded": False}
        for n in (1, 2, 3)
    ]
    first, second, third = records
    decided = {("m", 1): "allow"}

    def counted(found: list[Frame], *, revised: bool = False) -> tuple[int, int, int]:
        count = judged(found, records, decided, spoilt=False, revised=revised)
        return count.lost, count.twice, count.different

    assert counted(records) == (0, 0, 0)
    assert counted([first, second]) == (1, 0, 0)
    assert counted([*records, third | {"n": 4}])[:2] == (0, 1)
    assert counted([first, second | {"outcome": "false"}, third]) == (0, 0, 1)
    assert counted([first | {"decision": "deny"}, second, third])[2] == 1
    stands: Frame = dict.fromkeys(("stream", "kind", "stamp", "violation", "skewed"))
    records = [record | stands for record in records]
    first, second, third = records
    assert counted([first, third | {"n": 7, "outcome": "currently_true"}], revised=True) == (1, 0, 0)
    assert counted([first, second | {"outcome": "currently_false"}, third], revised=True) == (0, 0, 1)
    assert counted([first, second, third | {"n": 2}], revised=True)[1] == 1
