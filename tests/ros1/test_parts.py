"""What observes the streams of each kind."""

from __future__ import annotations

from oracle_adapter.kinds import KINDS
from oracle_ros1.parts import MAKERS


def test_every_type_of_interface_is_observed_filtered_or_not() -> None:
    assert MAKERS.keys() == {(kind.of, filtered) for kind in KINDS.values() for filtered in (False, True)}
