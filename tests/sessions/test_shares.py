"""What is charged, and who rests for how long, by a clock and a processor that stand still until they are told."""

from __future__ import annotations

import pytest

from oracle_server.sessions.shares import ACTIVE, FREE, LONGEST, Share, Shares


class Machine:
    """A clock and a processor."""

    def __init__(self) -> None:
        self.now = self.spent = 0.0

    def work(self, seconds: float) -> None:
        """Take so long, all of it on the processor."""
        self.now += seconds
        self.spent += seconds


@pytest.fixture
def machine() -> Machine:
    return Machine()


@pytest.fixture
def shares(machine: Machine) -> Shares:
    return Shares(lambda: machine.now, lambda: machine.spent)


def run(share: Share, machine: Machine, seconds: float) -> None:
    share.run(machine.work, seconds)


def others(shares: Shares, machine: Machine, number: int) -> None:
    """So many sessions are active."""
    for _ in range(number):
        run(shares.share(), machine, 1e-6)


def test_a_session_alone_never_rests(shares: Shares, machine: Machine) -> None:
    alone = shares.share()
    for _ in range(10):
        run(alone, machine, 0.5)
        assert alone.rest == 0


def test_a_session_whose_others_were_last_active_long_ago_never_rests(shares: Shares, machine: Machine) -> None:
    others(shares, machine, 3)
    machine.now += ACTIVE
    alone = shares.share()
    run(alone, machine, 0.5)
    assert alone.rest == 0


def test_a_session_rests_for_none_that_nobody_waits_for(shares: Shares, machine: Machine) -> None:
    gone, one = shares.share(), shares.share()
    run(gone, machine, 0.5)
    gone.set_awaited(awaited=False)
    run(gone, machine, 0.5)  # it is written, and closed
    run(one, machine, 0.5)
    assert one.rest == 0
    gone.set_awaited(awaited=True)
    run(gone, machine, 1e-6)
    run(one, machine, 0.5)
    assert one.rest > 0


@pytest.mark.parametrize(("number", "times"), [(1, 1), (2, 2), (3, 3), (4, 3), (500, 3)])
def test_beside_others_it_rests_until_its_share_is_one_of_as_many_and_a_quarter_at_least(
    shares: Shares, machine: Machine, number: int, times: int
) -> None:
    others(shares, machine, number)
    share = shares.share()
    run(share, machine, FREE)
    run(share, machine, FREE / 100)
    assert share.rest == pytest.approx(FREE * times, rel=0.3)


def spend_savings(share: Share, machine: Machine) -> None:
    """Let a session use up what it may take at once now and then."""
    run(share, machine, 10.0)
    machine.now += LONGEST


@pytest.mark.parametrize(("number", "times"), [(5, 10), (99, 198), (500, 200)])
def test_what_takes_long_at_once_is_the_rarer_the_more_wait_for_it(
    shares: Shares, machine: Machine, number: int, times: int
) -> None:
    share = shares.share()
    others(shares, machine, number)
    spend_savings(share, machine)
    others(shares, machine, number)
    run(share, machine, 0.010)
    assert share.rest == pytest.approx(max(3 * 0.010, times * (0.010 - FREE)), abs=0.011)
    run(share, machine, 5.0)
    others(shares, machine, number)
    assert share.rest == pytest.approx(LONGEST, abs=0.01)


def test_half_a_percent_of_the_time_at_most_is_beyond_what_is_free_beside_a_hundred_others(
    shares: Shares, machine: Machine
) -> None:
    share, beyond = shares.share(), 0.0
    for _ in range(100):
        others(shares, machine, 100)
        run(share, machine, 0.028)
        beyond += 0.028 - FREE
        machine.now += share.rest
    assert beyond / machine.now < 0.0052


def test_what_takes_long_now_and_then_is_no_reason_to_rest_longer(shares: Shares, machine: Machine) -> None:
    share = shares.share()
    for _ in range(5):
        others(shares, machine, 100)
        run(share, machine, 0.028)
        assert share.rest == pytest.approx(3 * 0.028, rel=0.01)
        machine.now += 6


def test_it_is_read_on_once_it_has_rested(shares: Shares, machine: Machine) -> None:
    others(shares, machine, 5)
    share = shares.share()
    run(share, machine, 0.003)
    machine.now += share.rest / 2
    assert share.rest > 0
    machine.now += share.rest * 1.001
    assert share.rest == 0
    run(share, machine, FREE / 2)
    assert share.rest == 0, "what it has rested for is forgotten"


def test_it_rests_no_longer_once_it_is_alone(shares: Shares, machine: Machine) -> None:
    others(shares, machine, 1)
    machine.now += 0.95 * ACTIVE
    share = shares.share()
    run(share, machine, 0.04)
    assert share.rest == pytest.approx(0.04)
    machine.now += 0.02 * ACTIVE
    assert share.rest == 0


def test_who_stays_below_its_share_never_rests(shares: Shares, machine: Machine) -> None:
    share = shares.share()
    for _ in range(1_000):
        others(shares, machine, 4)
        run(share, machine, 0.0002)
        assert share.rest == 0
        machine.now += 0.001


def test_each_is_charged_for_its_own(shares: Shares, machine: Machine) -> None:
    calm, greedy = shares.share(), shares.share()
    run(calm, machine, 1e-6)
    run(greedy, machine, 0.05)
    run(calm, machine, 1e-6)
    assert greedy.rest > 0
    assert calm.rest == 0


def test_time_that_others_have_the_processor_is_nobodys(shares: Shares, machine: Machine) -> None:
    others(shares, machine, 5)
    share = shares.share()

    def wait() -> None:
        machine.now += 0.3

    share.run(wait)
    assert share.rest == 0


def test_what_the_server_itself_wants_is_charged_once_and_without_the_surcharge(
    shares: Shares, machine: Machine
) -> None:
    others(shares, machine, 5)
    share = shares.share()

    def write() -> None:
        machine.work(0.001)
        share.run_for_server(machine.work, 0.05)

    share.run(write)
    assert share.rest == pytest.approx(3 * 0.051, rel=0.1)


def test_work_that_fails_is_charged(shares: Shares, machine: Machine) -> None:
    others(shares, machine, 5)
    share = shares.share()

    def fail() -> None:
        machine.work(0.01)
        raise ValueError

    with pytest.raises(ValueError):  # noqa: PT011 -- it is ours
        share.run(fail)
    assert share.rest > 0


def test_a_run_hands_back_what_came_of_it(shares: Shares) -> None:
    assert shares.share().run(divmod, 7, 2) == (3, 1)


async def test_one_can_wait_for_the_rest(shares: Shares, machine: Machine) -> None:
    slept: list[float] = []

    async def sleep(seconds: float) -> None:
        slept.append(seconds)
        machine.now += seconds

    others(shares, machine, 5)
    share = shares.share()
    await share.rested(sleep)
    assert slept == []
    run(share, machine, 0.01)
    await share.rested(sleep)
    assert sum(slept) == pytest.approx(3 * 0.010)
    assert share.rest == 0
