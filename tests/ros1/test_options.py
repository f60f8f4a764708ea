"""What the command line of the ROS 1 adapter says, and private parameters."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace

import pytest
from oracle_ros1 import options

LOG = {"log": "x.jsonl", "streams": "s.json"}


def read(*words: str) -> tuple[dict[str, object], list[str]]:
    """The options that words give, and what is left for ROS."""
    found, for_ros = options.read_options(["oracle_ros1", *words], "")
    return {name: value for name, value in vars(found).items() if value}, for_ros[0:]


def completed(
    words: list[str], parameters: Mapping[str, object], monkeypatch: pytest.MonkeyPatch, taken: list[str] | None = None
) -> tuple[object, int]:
    """The options by the command line and by parameters, and how many of these were not taken; the rest is `taken`."""
    taken = [] if taken is None else taken
    ros = SimpleNamespace(
        get_param=lambda name, default: parameters.get(name.strip("~"), default), resolve_name=lambda name: name
    )
    monkeypatch.setattr(options, "rospy", ros)
    told: list[str] = []
    found, _ = options.read_options(["oracle_ros1", *words], "")
    options.complete(found, told.append, taken.append)
    return found, len(told)


def test_words_of_ros_are_options_and_go_no_further() -> None:
    words = ("_spec:=watch", "--session", "s", "_monitor:=uav7", "__name:=x", "/a:=/b", "_own:=1", "--remap", "/c:=/d")
    found, for_ros = read(*words)
    assert found == {"spec": "watch", "session": "s", "monitor": "uav7", "remap": ["/c:=/d"]}
    assert for_ros == ["__name:=x", "/a:=/b", "_own:=1"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--spec", "a", "_spec:=b"), "--spec and _spec:= contradict each other"),
        (("--log", "x", "--streams", "y", "--spec", "a"), "--log asks no oracle: leave --spec out"),
        (("_log:=x", "_streams:=y", "--session", "a"), "--log asks no oracle: leave --session out"),
        (("--streams", "y"), "--streams is for --log"),
        (("--monitor", "u" * 201), "--monitor: a name has at most 200 characters"),
    ],
)
def test_contradictions_are_refused(words: tuple[str, ...], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        read(*words)
    assert stop.value.code == 2
    assert told in capsys.readouterr().err


def test_a_parameter_that_is_left_does_not_turn_a_guard_into_a_logger(monkeypatch: pytest.MonkeyPatch) -> None:
    found, told = completed(["--oracle", "http://a", "--spec", "g"], {**LOG, "session": "one"}, monkeypatch)
    assert (found.log, found.streams, found.session, told) == (None, None, "one", 2)  # type: ignore[attr-defined]


@pytest.mark.parametrize("words", [["--session", "s"], ["--embedded", "g.yaml"]])
def test_a_left_log_is_not_taken_beside_what_names_a_session_or_a_spec(
    words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found, told = completed(words, LOG, monkeypatch)
    assert (found.log, told) == (None, 2)  # type: ignore[attr-defined]


def test_a_log_on_the_command_line_is_written_whatever_parameters_say(monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["--log", "x", "--streams", "y"]
    found, told = completed(words, {"oracle": "http://a", "spec": "g", "monitor": "uav1"}, monkeypatch)
    assert (found.log, found.spec, found.monitor, told) == ("x", None, "uav1", 2)  # type: ignore[attr-defined]


def test_a_namespace_of_the_robots_that_is_called_as_an_option_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    parameters = {"log": {"level": 3}, "session": 7, "spec": "g", "monitor": "uav1"}
    found, told = completed([], parameters, monkeypatch)
    assert (found.log, found.session, found.spec, told) == (None, "7", "g", 0)  # type: ignore[attr-defined]


def test_it_is_told_which_parameters_are_taken_as_they_may_be_the_robots_own(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[str] = []
    completed(["--spec", "g"], {"namespace": "/drone", "spec": "h", "token": "secret"}, monkeypatch, taken)
    assert taken == ["options by parameters: ~namespace = /drone, ~token"]
    with pytest.raises(ValueError, match="--log asks no oracle"):
        completed([], {**LOG, "spec": "g"}, monkeypatch, taken)
    assert taken[1:] == ["options by parameters: ~log = x.jsonl, ~spec = g, ~streams = s.json"]
    completed(["--spec", "g"], {}, monkeypatch, taken)
    assert len(taken) == 2


def test_parameters_that_contradict_each_other_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="--log asks no oracle"):
        completed([], {**LOG, "spec": "g"}, monkeypatch)


@pytest.mark.parametrize(
    ("value", "session"), [('"42"', "42"), ("'a b'", "a b"), ("007", "007"), ("a: b", "a: b"), ("[", "[")]
)
def test_a_value_may_be_in_quotes_as_ros_reads_it(value: str, session: str) -> None:
    found, _ = read("_spec:=g", f"_session:={value}")
    assert found == {"spec": "g", "session": session}
