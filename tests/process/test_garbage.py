"""What makes many objects that stay is not looked through for garbage meanwhile."""

from __future__ import annotations

import gc

from oracle_server.process.garbage import uncollected


def test_nothing_is_collected_for_a_while() -> None:
    with uncollected():
        assert not gc.isenabled()
    assert gc.isenabled()
