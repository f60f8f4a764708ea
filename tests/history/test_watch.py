"""A connection is given up where PostgreSQL is silent, and not where this process stood still."""

from __future__ import annotations

from oracle_server.history.postgres.watch import LOOK_EVERY, Watch

PATIENCE = 10.0


class _Asked:
    """A connection that waits for an answer."""

    def __init__(self, watch: Watch) -> None:
        self._watch, self._since = watch, watch.now()
        self.severed = False

    def sever_if_silent(self) -> None:
        self.severed = self._watch.now() - self._since > PATIENCE


def test_silence_is_counted_while_this_process_runs() -> None:
    at = 100.0
    watch = Watch(lambda: at)
    asked = _Asked(watch)

    def run(seconds: float) -> None:
        nonlocal at
        for _ in range(round(seconds / LOOK_EVERY)):
            at += LOOK_EVERY
            watch.look()

    watch.add(asked)
    run(PATIENCE - 4)
    at += 3600.0  # as by SIGSTOP: what PostgreSQL said meanwhile is still to be read
    watch.look()
    run(2)
    assert not asked.severed
    run(3)
    assert asked.severed
