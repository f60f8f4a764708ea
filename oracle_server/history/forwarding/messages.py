"""What the process that forwards is asked, and answers."""

from __future__ import annotations

from typing import Literal

import msgspec


class Ask(msgspec.Struct):
    """Bring some more of the file at `path` (by `os.fsencode`) to the centre at `url`: at most so many rows.

    `robot` and `seq` are what the robot's history knows of its forwarding. A URL may have a password: it is told here,
    and not as an argument, which all users can read.
    """

    path: bytes
    url: str
    origin: str
    robot: str
    seq: int
    rows: int


class Told(msgspec.Struct):
    """What was brought: so many rows, up to a change, and up to which position of which sessions.

    `left` are the rows that are still to be brought, `oldest` is when the first step among them was judged (ns).
    `anew`: nothing was brought, since the centre has less than was known of it (`less`), or another history than
    this one, as a copy or a backup has it (`other`): all is to be forwarded from the beginning.
    `lost` are the steps that were deleted before they could be brought, as the centre was told this time, `dropped`
    those that it did not take, since it has deleted their session. `shared`: the connection is new, and another history
    came by this origin lately. `error` says why nothing was brought; it may be
    tried again.
    """

    rows: int = 0
    seq: int = 0
    reached: dict[int, int] = {}
    left: int = 0
    oldest: int | None = None
    lost: int = 0
    dropped: int = 0
    shared: bool = False
    anew: Literal["less", "other"] | None = None
    error: str | None = None
