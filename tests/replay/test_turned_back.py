"""Times that go back in a file, as those of a simulation that begins anew: they are said, and verdicts degraded."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from tests.replay.judging import BASE, MS, judge, write_spec

SPEC = """
id: numbers
ordering: {by: arrival}
streams: [{topic: /x, type: std_msgs/msg/Float64, signals: {x: msg.data}}]
properties: [{id: rises, formula: 'forall[n, m]. {x: *n} and pre {x: *m} -> *m <= *n'}]
"""
FORMS = ["mcap", "db3", "bag"]
SAID = "/x: its times go back, as where a simulation begins anew"


def write(folder: Path, form: str, messages: list[tuple[str, int]]) -> Path:
    """A bag of numbers, each as large as its time in ms, in the order in which they are given."""
    name = "std_msgs/msg/Float64"
    store = get_typestore(Stores.ROS1_NOETIC if form == "bag" else Stores.ROS2_HUMBLE)
    path = folder / f"x.{form}"
    storage = StoragePlugin.SQLITE3 if form == "db3" else StoragePlugin.MCAP
    with Writer1(path) if form == "bag" else Writer2(path, version=9, storage_plugin=storage) as writer:
        topics = dict.fromkeys(topic for topic, _ in messages)
        ids = {topic: writer.add_connection(topic, name, typestore=store) for topic in topics}
        serialize = store.serialize_ros1 if form == "bag" else store.serialize_cdr
        for topic, at in messages:
            writer.write(ids[topic], BASE + at * MS, serialize(store.types[name](data=float(at)), name))
    return path


def run(first: int, last: int, topic: str = "/x") -> list[tuple[str, int]]:
    return [(topic, at) for at in range(first, last, 100)]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("runs", [(5_000, 9_000), (9_000, 5_000), (9_000, 9_000)])
def test_a_simulation_that_begins_anew_is_said(runs: tuple[int, int], form: str, tmp_path: Path) -> None:
    bag = write(tmp_path, form, [("/other", 0), *chain.from_iterable(run(0, end) for end in runs)])
    found = judge(write_spec(tmp_path, SPEC), bag)
    assert found.summary["events"] == sum(runs) // 100
    assert found.said.count(SAID) == 1, found.said
    assert (found.exit, found.strict) == (0, 3)
    assert found.rows[-1]["degraded"]


@pytest.mark.parametrize("form", FORMS)
def test_messages_that_are_a_little_out_of_order_are_no_matter(form: str, tmp_path: Path) -> None:
    """Nor are topics that were written one after the other, as where bags are put together."""
    moved = [(topic, at + (900 if at % 300 == 0 else 0)) for topic, at in run(0, 9_000)]
    found = judge(write_spec(tmp_path, SPEC), write(tmp_path, form, [*run(0, 9_000, "/other"), *moved]))
    assert (found.summary["events"], found.exit, found.strict, found.said) == (90, 0, 0, "")
