"""The end of a recording, where something fails at it or it does not come."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, cast

from oracle_server.jobs.recordings import Recording, Recordings


class Broken:
    """Whatever is asked of it fails."""

    async def remove(self, path: Path) -> None:
        raise OSError(f"{path} can't be deleted")


def begun() -> tuple[Recordings, Recording]:
    nothing: Any = None
    return Recordings(nothing, nothing, cast("Any", Broken())), Recording("r1", "client", "x.jsonl", "spec", None)


async def test_it_has_ended_though_what_it_leaves_can_not_be_removed() -> None:
    recordings, one = begun()
    await recordings._finish(one, cast("Any", None), Path("x.jsonl"), "judged")
    assert one.ended.is_set()
    assert (one.state, one.error is None) == ("failed", False)


async def test_who_cancels_one_that_does_not_end_waits_no_longer_than_said() -> None:
    recordings, one = begun()
    one.state, one.task = "judging", asyncio.create_task(asyncio.sleep(0))
    async with asyncio.timeout(60):
        await recordings.cancel(one, 0.01)
    assert (one.state, one.ended.is_set()) == ("judging", False)
