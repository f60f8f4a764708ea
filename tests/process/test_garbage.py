"""Garbage is looked for seldom and briefly, and is found all the same."""

from __future__ import annotations

import gc
import subprocess
import sys

from oracle_server.process.garbage import uncollected


def test_nothing_is_collected_for_a_while() -> None:
    with uncollected():
        assert not gc.isenabled()
    assert gc.isenabled()


def check(script: str) -> None:
    """Run a script in an interpreter of its own: what it does holds for all that there is."""
    begin = "import gc, weakref\nfrom oracle_server.process import garbage\ngarbage.collect_rarely()\n"
    done = subprocess.run([sys.executable, "-c", begin + script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_what_a_full_collection_leaves_is_not_looked_through_again() -> None:
    check(
        """
kept = [[] for _ in range(1000)]
assert any(one is kept[0] for one in gc.get_objects())
gc.collect()
assert not any(one is kept[0] for one in gc.get_objects())
"""
    )


def test_what_was_left_is_freed_with_its_last_reference() -> None:
    check(
        """
class Kept: ...
kept = Kept()
found = weakref.ref(kept)
gc.collect()
del kept
assert found() is None
"""
    )


def test_cycles_of_what_was_left_are_freed_once_there_is_very_much() -> None:
    check(
        """
class Kept: ...
kept = Kept()
kept.itself, found = kept, weakref.ref(kept)
gc.collect()
del kept
for _ in range(3 * garbage._LOOK_EACH):
    gc.collect()
assert found() is not None, 'nothing was to be looked through'
garbage._full._most = 0
for _ in range(3 * garbage._LOOK_EACH):
    gc.collect()
assert found() is None
assert gc.get_freeze_count() > 0
"""
    )


def test_what_is_collected_deep_within_a_message_is_no_failure() -> None:
    check(
        """
def within(depth):
    return garbage._full('stop', {'generation': 2}) if depth == 0 else within(depth - 1)

def place_of(depth):
    try:
        within(depth)
    except RecursionError as error:
        trace = error.__traceback__
        while trace.tb_next is not None:
            trace = trace.tb_next
        return 'called' if trace.tb_frame.f_code is within.__code__ else 'in the collection'
    return 'done'

found = [place_of(depth) for depth in range(900, 1000)]
assert {*found} == {'called', 'done'}, found
"""
    )
