"""Each monitor of a configuration has an oracle of its own, or none: what becomes of them in one spec."""

from __future__ import annotations

from pathlib import Path

from oracle_server.core.spec import External
from tests.specfiles.test_import import imported
from tests.whole.harness import run

LOG = """
  - monitor:
      id: log
      topics:
        - {name: pose, type: geometry_msgs.msg.PoseStamped, action: log}
"""
GUARD = """
  - monitor:
      id: guard
      oracle: {port: 8081, url: 10.0.0.1, action: nothing}
      topics:
        - {name: chatter, type: std_msgs.msg.String, action: filter, publishers: [talker]}
        - {name: /shared, type: std_msgs.msg.String, action: log}
"""
COUNT = """
  - monitor:
      id: count
      oracle: {port: 8082, url: 10.0.0.2, action: nothing, timeout: 3}
      topics:
        - {name: /count, type: std_msgs.msg.Int32, action: filter, subscribers: [listener]}
        - {name: /shared, type: std_msgs.msg.String, action: log}
"""
AHEAD = "PROPERTY = 'F hello'\npredicates = dict(hello=False)\ndef abstract_message(m):\n    return predicates\n"


def test_an_oracle_is_told_what_its_own_monitor_told_it_and_denies_what_that_filtered(tmp_path: Path) -> None:
    _, spec = imported(tmp_path, "monitors:" + GUARD + COUNT)
    guard, count = spec.properties
    assert (guard.id, guard.guards) == ("oracle_guard", {"/chatter"})
    assert guard.external == External("ws://10.0.0.1:8081", 2 * 10**9, frozenset({"/chatter", "/shared"}))
    assert (count.id, count.guards) == ("oracle_count", {"/count"})
    assert count.external == External("ws://10.0.0.2:8082", 3 * 10**9, frozenset({"/count", "/shared"}))
    assert {s.decide_within for s in spec.streams if s.action == "filter"} == {3_100 * 10**6}


def test_the_oracle_of_a_later_monitor_is_asked_at_its_own_address(tmp_path: Path) -> None:
    for config in (LOG + GUARD, GUARD + LOG):
        _, spec = imported(tmp_path, "monitors:" + config)
        (prop,) = spec.properties
        assert (prop.id, prop.guards) == ("oracle", {"/chatter"})
        assert prop.external == External("ws://10.0.0.1:8081", 2 * 10**9, frozenset({"/chatter", "/shared"}))


def test_monitors_that_only_log_are_no_reason_to_ask_an_oracle(tmp_path: Path) -> None:
    text, spec = imported(tmp_path, "monitors:" + LOG, ends=1)
    assert [prop.external for prop in spec.properties] == [None]
    assert "no monitor has an `oracle`, so that nothing was judged" in text
    text, spec = imported(tmp_path, "monitors:" + LOG, ends=1, ahead=AHEAD)
    assert [(prop.id, prop.external) for prop in spec.properties] == [("ahead", None)]
    assert "its formula is about what comes, and no monitor has an `oracle` that judges it" in text


def test_a_filter_without_an_oracle_denies_until_something_is_written_or_is_refused(tmp_path: Path) -> None:
    alone = LOG.replace("action: log", "action: filter")
    _, spec = imported(tmp_path, "monitors:" + alone, ends=1)
    (prop,) = spec.properties
    assert (prop.external, prop.guards) == (None, {"/pose"})
    config = tmp_path / "config.yaml"
    config.write_text("monitors:" + GUARD + alone)
    ended = run("import", config)
    assert ended.returncode == 1
    assert "/pose is filtered, but no property guards it" in ended.stderr


def test_a_formula_about_what_comes_stays_with_each_oracle_that_may_have_judged_it(tmp_path: Path) -> None:
    _, spec = imported(tmp_path, "monitors:" + GUARD + COUNT, ahead=AHEAD)
    assert [(prop.id, prop.external is not None) for prop in spec.properties] == [
        ("ahead_guard", True),
        ("ahead_count", True),
    ]
