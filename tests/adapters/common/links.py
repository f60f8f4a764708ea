"""How the tests of the link ask, and how long they wait."""

from __future__ import annotations

from typing import TYPE_CHECKING

from oracle_adapter import Answer, Link, Timing

if TYPE_CHECKING:
    from concurrent.futures import Future

PATIENCE = 60.0
QUICK = Timing(
    open_timeout=PATIENCE,
    attach_timeout=PATIENCE,
    ping_timeout=PATIENCE,
    backoff_first=0.01,
    backoff_last=0.05,
    name_timeout=PATIENCE,
)
"""Quick to connect again, and slow to give up: on a busy machine who is silent is not dead."""


def answer_of(future: Future[Answer]) -> Answer:
    return future.result(PATIENCE)


def ask(link: Link, within: float = PATIENCE) -> Future[Answer]:
    return link.ask("/a", "request", None, {}, decide_within=within)
