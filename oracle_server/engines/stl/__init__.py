"""Signal temporal logic with robustness, on rtamt; where that is not installed, this package raises an error."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib.util import find_spec

from oracle_server.core.errors import EngineError
from oracle_server.core.formula.tree import Position
from oracle_server.extras import install

_EQUALITIES = {
    "==": "is at most on its border, where both sides are equal, so that nothing which asks for it holds, and what "
    "follows from it is never violated; write two inequalities with a margin, as in `mode > 1.5 and mode < 2.5`",
    "!==": "is at least on its border, where both sides are equal, so that nothing which asks for it is violated; "
    "write two inequalities with a margin, as in `mode < 1.5 or mode > 2.5`",
}


def demand() -> None:
    """Raises `EngineError` where rtamt is not installed."""
    if find_spec("rtamt") is not None:
        return
    mend = install("rtamt")
    if sys.version_info >= (3, 13):
        mend = f"it runs on Python up to 3.12, and this is {sys.version_info.major}.{sys.version_info.minor}"
    raise EngineError(f"`engine: rtamt` needs rtamt, which is not installed: {mend}")


def equalities(text: str) -> Iterator[tuple[str, Position]]:
    """What is to be said of each comparison of a formula that has no robustness on one of its sides, and its place."""
    for found in re.finditer("!?==", text):
        line, begin = text.count("\n", 0, found.start()) + 1, text.rfind("\n", 0, found.start()) + 1
        yield f"`{found[0]}` {_EQUALITIES[found[0]]}", (line, found.start() - begin + 1)
