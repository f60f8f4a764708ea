"""A campaign by hand: `python -m tests.fuzz --frames 1000000`. Ends with 1 where anything is not as it must be."""

from __future__ import annotations

import argparse
import asyncio
import random
import sys
import tempfile
import time
from pathlib import Path

from tests.chaos.served import Served
from tests.fuzz.campaign import Count, leg, prepare, restarted

_COLUMNS = "{:>10} {:>10} {:>10} {:>10} {:>8} {:>8}"


async def campaign(frames: int, seed: int) -> Count:
    """Send so many frames to one server, in legs of 10,000."""
    began, total, number = time.monotonic(), Count(), 0
    print(_COLUMNS.format("frames", "judged", "events", "asked", "wrong", "seconds"))
    with tempfile.TemporaryDirectory() as name:
        async with Served(prepare(Path(name) / "specs"), Path(name) / "data") as served:
            while total.frames < frames and not total.wrong:
                total += await leg(served, number, min(10_000, frames - total.frames), seed)
                number += 1
                passed = round(time.monotonic() - began)
                print(
                    _COLUMNS.format(total.frames, total.judged, total.events, total.asked, len(total.wrong), passed),
                    flush=True,
                )
            total += await restarted(served, seed)
            if await served.stop() != 0:
                total.wrong.append("the server did not end well")
    return total


def main() -> None:
    """Run it as the command line says."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000, help="how many frames are sent, at least")
    parser.add_argument("--seed", type=int, default=random.randrange(2**32))
    options = parser.parse_args()
    print(f"--seed {options.seed}", file=sys.stderr)
    total = asyncio.run(campaign(options.frames, options.seed))
    for what in total.wrong[:20]:
        print(what[:2000], file=sys.stderr)
    sys.exit(1 if total.wrong else 0)


if __name__ == "__main__":
    main()
