"""What observes the streams of each kind."""

from __future__ import annotations

import pytest

parts = pytest.importorskip("oracle_ros2.parts")
kinds = pytest.importorskip("oracle_adapter.kinds")


def test_every_type_of_interface_is_observed_filtered_or_not() -> None:
    assert parts.MAKERS.keys() == {(kind.of, filtered) for kind in kinds.KINDS.values() for filtered in (False, True)}
