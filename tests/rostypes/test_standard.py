"""The table of the standard packages is what rosbags has, and more."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_typestore

from oracle_server.core.hazards.readings import at
from oracle_server.core.hazards.ros import Ros
from oracle_server.core.shapes import Many, Record, Shape, Unknown, Value
from oracle_server.core.typed import TypedMessage
from oracle_server.rostypes import standard
from oracle_server.rostypes.known import Types

VERSIONS: tuple[Ros | None, ...] = (None, 1, 2)


@pytest.mark.parametrize("store", [s for s in Stores if s.value.startswith("ros")], ids=lambda s: s.value)
def test_every_message_of_every_distribution_is_in_the_table(store: Stores) -> None:
    ros: Ros = 1 if store is Stores.ROS1_NOETIC else 2
    for name, (_, fields) in get_typestore(store).fielddefs.items():
        assert {field for field, _ in fields} in [set(v) for v in standard.variants(name, ros)], name


def test_every_type_of_the_table_has_a_shape() -> None:
    types = Types(environment={})
    for name in standard.names():
        for ros in VERSIONS:
            found = types.message(name, ros)
            assert isinstance(found, TypedMessage), (name, found)
            assert _leaves(found.widest) or not found.widest.fields


def _leaves(shape: Shape) -> list[Value]:
    match shape:
        case Value():
            return [shape]
        case Many():
            return _leaves(shape.of)
        case Unknown():
            raise AssertionError(shape)
        case Record():
            assert all(at(shape, (name,)) == inner for name, inner in shape.fields.items())
            return [leaf for inner in shape.fields.values() for leaf in _leaves(inner)]
