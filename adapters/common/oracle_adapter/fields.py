"""Which fields of a message are read, and what their numbers are: 32-bit floats, and times."""

from __future__ import annotations

import struct
from typing import Dict, Iterable, List, Optional, Union

_SINGLE = struct.Struct("<f")


def grouped(paths: Iterable[str]) -> Dict[str, Optional[List[str]]]:
    """Dotted paths by their first name: the paths inside it, or None where all of it is read."""
    wanted: Dict[str, Optional[List[str]]] = {}
    for path in paths:
        name, _, rest = path.partition(".")
        inner = wanted.setdefault(name, [])
        if rest and inner is not None:
            inner.append(rest)
        else:
            wanted[name] = None
    return wanted


def not_there(message_type: str, paths: Iterable[str]) -> str:
    """What to say of fields that a spec reads and the type lacks; empty where it lacks none."""
    read = " and ".join(f"msg.{path}" for path in paths)
    return f"the spec reads {read}, which {message_type} does not have here" if read else ""


def nanoseconds(seconds: Union[int, float]) -> Optional[int]:
    """A number of seconds as a time (ns), as the server reads it; None for one that is none."""
    if isinstance(seconds, int):
        time = seconds * 10**9
    elif 0 < seconds < 2**63:
        time = round(seconds * 10**9)
    else:
        return None
    return time if 0 < time < 2**63 else None


def shortest(value: float) -> float:
    """A 32-bit float as the shortest decimal that means it: 0.1, not 0.10000000149011612."""
    for digits in (6, 7, 8):
        short = float(f"{value:.{digits}g}")
        try:
            if _SINGLE.unpack(_SINGLE.pack(short))[0] == value:
                return short
        except OverflowError:  # rounded up, beyond the largest
            continue
    return float(f"{value:.9g}")
