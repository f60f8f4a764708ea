"""A campaign by hand: `python -m tests.chaos --kills 1000`. Ends with 1 where anything is lost, twice or different."""

from __future__ import annotations

import argparse
import asyncio
import random
import sys
import tempfile
import time
from itertools import cycle
from pathlib import Path

from tests.chaos.campaign import KINDS, Count, Kind, run_round
from tests.chaos.disk import Unmountable
from tests.chaos.runs import TRIO, observed, uninterrupted

_COLUMNS = "{:42} {:>6} {:>9} {:>6} {:>6} {:>6} {:>10}"


async def campaign(kills: int, each: int, chance: random.Random, only: str = "") -> int:
    """Run rounds of all kinds, or of some, in turn until there were so many kills; returns how much was wrong."""
    trace, began = observed(), time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        expected = await uninterrupted(TRIO, trace, Path(name), {})
    totals = {kind: Count() for kind in KINDS if only in kind.name}
    turns = cycle(list(totals))
    left_out: set[Kind] = set()
    while sum(total.kills for total in totals.values()) < kills:
        kind = next(turns)
        if kind in left_out:
            continue
        with tempfile.TemporaryDirectory() as name:
            try:
                count = await run_round(kind, trace, expected, Path(name), chance, each)
            except Unmountable as error:
                print(f"left out: {kind.name}: {error}", file=sys.stderr)
                left_out.add(kind)
                continue
        totals[kind] += count
        print(_line(kind.name, count), file=sys.stderr, flush=True)
    print(_COLUMNS.format("rounds", "kills", "acked", "late", "lost", "twice", "different"))
    for kind, total in totals.items():
        print(_line(kind.name, total))
    total = sum(totals.values(), Count())
    print(_line(f"all, {time.monotonic() - began:.0f} s", total))
    return total.failures


def _line(name: str, count: Count) -> str:
    return _COLUMNS.format(name, count.kills, count.acked, count.late, count.lost, count.twice, count.different)


def main() -> None:
    """Run it as the command line says."""
    parser = argparse.ArgumentParser(prog="python -m tests.chaos", description=__doc__)
    parser.add_argument("--kills", type=int, default=1000, help="how often the server is killed, at least")
    parser.add_argument("--each", type=int, default=10, help="kills a round")
    parser.add_argument("--only", default="", help="rounds of one kind: those whose name has this text")
    parser.add_argument("--seed", type=int, default=random.randrange(2**32))
    options = parser.parse_args()
    print(f"--seed {options.seed}", file=sys.stderr)
    chance = random.Random(options.seed)
    sys.exit(1 if asyncio.run(campaign(options.kills, options.each, chance, options.only)) else 0)


if __name__ == "__main__":
    main()
