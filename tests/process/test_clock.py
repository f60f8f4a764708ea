"""The server's clock, whatever becomes of the machine's."""

from __future__ import annotations

import time

import pytest

from oracle_server.process.clock import MAX_AHEAD, MAX_APART, Clock

SECOND = 10**9
YEARS = 40 * 365 * 86_400 * SECOND


class Machine:
    """A machine's clocks, which a test sets."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.wall, self.ticks, self.slept = 1_700_000_000 * SECOND, 5 * SECOND, 0
        monkeypatch.setattr(time, "time_ns", lambda: self.wall)
        monkeypatch.setattr(time, "monotonic_ns", lambda: self.ticks)
        monkeypatch.setattr(time, "clock_gettime_ns", lambda kind: self.ticks + self.slept)

    def pass_by(self, seconds: int) -> None:
        self.wall += seconds * SECOND
        self.ticks += seconds * SECOND


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    return Machine(monkeypatch)


def test_a_clock_that_is_set_back_goes_on_slowly_until_the_two_agree(machine: Machine) -> None:
    clock, begin = Clock(), machine.wall
    machine.wall -= SECOND
    assert clock.now() == begin
    machine.pass_by(1)
    assert clock.now() == begin + SECOND // 2
    machine.pass_by(1)
    assert clock.now() == machine.wall == begin + SECOND


def test_a_clock_that_is_set_back_by_more_goes_on_at_full_speed(
    machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    """At half speed what was 80 ms ago counted as within the last 50 ms, as long as the two did not agree."""
    clock, begin = Clock(), machine.wall
    machine.pass_by(10)
    machine.wall -= 20 * SECOND
    assert clock.now() == begin + 10 * SECOND
    machine.pass_by(30)
    assert (clock.now(), clock.far, clock.ahead) == (begin + 40 * SECOND, True, 20 * SECOND)
    assert capsys.readouterr().out.count("was set back") == 1
    machine.wall += 20 * SECOND
    machine.pass_by(1)
    assert (clock.now(), clock.far) == (begin + 41 * SECOND, False)


def test_a_clock_that_is_set_ahead_is_followed_and_that_is_told(
    machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    """As where the machine slept: nothing said why each deadline of meanwhile was a violation."""
    clock = Clock()
    machine.pass_by(3600)
    machine.wall += SECOND
    assert clock.now() == machine.wall
    assert capsys.readouterr().out == ""
    machine.wall += 1800 * SECOND
    assert clock.now() == machine.wall
    assert "was set ahead, or the machine slept" in (said := capsys.readouterr().out)
    assert "seconds=1800" in said
    machine.wall -= 1800 * SECOND
    ahead = clock.now()
    machine.wall += 1800 * SECOND
    assert clock.now() == ahead
    assert "ahead" not in capsys.readouterr().out


def test_a_server_begins_no_more_than_an_hour_ahead(machine: Machine, capsys: pytest.CaptureFixture[str]) -> None:
    assert Clock(machine.wall + MAX_AHEAD).now() == machine.wall + MAX_AHEAD
    assert capsys.readouterr().out == ""
    assert Clock(machine.wall + YEARS).now() == machine.wall
    assert f"seconds={YEARS // SECOND}" in capsys.readouterr().out


def test_a_clock_that_was_years_ahead_goes_on_at_full_speed_and_says_so_once(
    machine: Machine, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = Clock()
    machine.wall += YEARS
    ahead = clock.now()
    machine.wall -= YEARS
    clock.now()
    assert "was set back" in capsys.readouterr().out
    for passed in (1, 2, 3):
        machine.pass_by(1)
        assert clock.now() == ahead + passed * SECOND
    assert capsys.readouterr().out == ""


def test_a_session_that_has_lived_later_keeps_its_time_and_no_other_does(machine: Machine) -> None:
    clock = Clock()
    later = machine.wall + YEARS
    own = clock.since(later)
    assert clock.since(0) is clock
    assert own.far
    machine.pass_by(7)
    assert own.now() == later + 7 * SECOND
    assert clock.now() == machine.wall


def test_what_begins_while_a_clock_is_ahead_begins_by_the_wall_clock(machine: Machine) -> None:
    """Its stamps are the wall clock's: by the other's time all its deadlines would have run out already."""
    clock = Clock()
    machine.wall -= MAX_APART
    assert clock.since(0) is clock
    machine.wall -= 1800 * SECOND
    began = machine.wall
    own = clock.since(0)
    machine.pass_by(5)
    assert (own.now(), own.ahead, own.far) == (machine.wall, 0, False)
    assert clock.ahead > 1700 * SECOND
    assert clock.since(began + 10 * SECOND).now() == began + 10 * SECOND, "and what has lived goes on from there"


def test_what_has_lived_later_at_a_machine_whose_clock_is_ahead_goes_on_from_there_slowly(machine: Machine) -> None:
    """As a session that is taken over: its time stood still, so that nothing waited for its turn."""
    clock, later = Clock(), machine.wall + 10 * SECOND
    own = clock.since(later)
    assert (own.now(), own.far) == (later, False)
    machine.pass_by(4)
    assert (own.now(), clock.now()) == (later + 2 * SECOND, machine.wall)
    machine.pass_by(30)
    assert own.now() == clock.now() == machine.wall


def test_what_a_clock_leapt_over_did_not_pass(machine: Machine) -> None:
    """As at a robot that starts in 1970: what is kept for a day was deleted as soon as its clock was set."""
    clock, begun = Clock(), machine.wall
    machine.pass_by(60)
    assert clock.ago(60 * SECOND) == begun
    machine.wall += YEARS
    assert clock.now() == machine.wall
    machine.pass_by(10)
    clock.now()
    machine.wall += 3600 * SECOND
    clock.now()
    machine.pass_by(5)
    told = [clock.ago(passed * SECOND) for passed in (5, 6, 15, 16, 75)]
    assert told == [
        machine.wall - 5 * SECOND,
        begun + YEARS + 69 * SECOND,
        begun + YEARS + 60 * SECOND,
        begun + 59 * SECOND,
        begun,
    ]


def test_what_the_machine_slept_through_has_passed(machine: Machine) -> None:
    clock, begun = Clock(), machine.wall
    machine.wall += 3600 * SECOND
    machine.slept += 3600 * SECOND
    assert clock.now() == machine.wall
    assert clock.ago(3600 * SECOND) == begun
