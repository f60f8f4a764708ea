"""Signal temporal logic with robustness, on rtamt; where that is not installed, this package raises an error."""

from __future__ import annotations

import sys
from importlib.util import find_spec

from oracle_server.core.errors import EngineError


def demand() -> None:
    """Raises `EngineError` where rtamt is not installed."""
    if find_spec("rtamt") is not None:
        return
    mend = "pip install 'oracle-server[rtamt]'"
    if sys.version_info >= (3, 13):
        mend = f"it runs on Python up to 3.12, and this is {sys.version_info.major}.{sys.version_info.minor}"
    raise EngineError(f"`engine: rtamt` needs rtamt, which is not installed: {mend}")
