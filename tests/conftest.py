"""What takes long on a busy machine is not wrong: no example has a deadline. Nor does a terminal's width count.

Where the tests are started in the background, a shell lets them ignore Ctrl-C, and so would what they start.
"""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Generator, Iterator

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("patient", settings(deadline=None, suppress_health_check=[HealthCheck.too_slow]))
settings.load_profile("patient")

os.environ.pop("COLUMNS", None)
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

gc.set_threshold(20_000)


@pytest.fixture(autouse=True)
def _environment_is_kept() -> Iterator[None]:
    """What a test leaves in the environment, all that are behind it would run with."""
    before = dict(os.environ)
    yield
    changed = {name for name in before.keys() | os.environ.keys() if before.get(name) != os.environ.get(name)}
    assert not changed - {"PYTEST_CURRENT_TEST"}


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Let no collection of garbage look at all the tests that there are: while they are found nearly none is made."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()
