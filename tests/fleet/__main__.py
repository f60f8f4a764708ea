"""A campaign by hand: `python -m tests.fleet --faults 200`. Ends with 1 where something is lost, twice or otherwise."""

from __future__ import annotations

import argparse
import asyncio
import itertools
import random
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

from tests.fleet.campaign import Count, run_round
from tests.fleet.cluster import FAULTS
from tests.postgres import Postgres


def main() -> None:
    """Run it as the command line says."""
    parser = argparse.ArgumentParser(prog="python -m tests.fleet", description=__doc__)
    parser.add_argument("--faults", type=int, default=200)
    parser.add_argument("--each", type=int, default=20, help="faults a round")
    parser.add_argument("--sessions", type=int, default=200, help="sessions a round")
    parser.add_argument("--only", default="", help="faults of one kind: those whose name has this text")
    parser.add_argument("--seed", type=int, default=random.randrange(2**32))
    options = parser.parse_args()
    print(f"--seed {options.seed}", flush=True)
    chance = random.Random(options.seed)
    chosen = [fault for fault in FAULTS if options.only in fault.__name__.replace("_", " ")]
    chance.shuffle(chosen)
    turns, total, failed, begun = itertools.cycle(chosen), Count(Counter()), 0, time.monotonic()
    with Postgres({"max_connections": "120"}) as postgres:
        while total.faults.total() < options.faults:
            faults = [*itertools.islice(turns, min(options.each, options.faults - total.faults.total()))]
            with tempfile.TemporaryDirectory() as name:
                try:
                    count = asyncio.run(run_round(postgres, Path(name), options.sessions, faults, chance, print))
                except Exception:  # noqa: BLE001 - what is found is told, and the next round begun
                    traceback.print_exc()
                    failed += 1
                    total.faults.update(["in a round that failed"] * len(faults))
                    continue
            total.faults += count.faults
            total.acked += count.acked
            total.records += count.records
            total.unknown += count.unknown
            total.moves += count.moves
            total.otherwise += count.otherwise
            print(f"{total.faults.total()} faults, {total.acked} acked, {time.monotonic() - begun:.0f} s", flush=True)
    for name, number in total.faults.most_common():
        print(f"{number:5} {name}")
    print(f"{total.acked} events acked, {total.records} verdicts, {total.unknown} unknown")
    for name, number in total.otherwise.most_common():
        print(f"{number:5} decisions were {name}")
    print(f"sessions went to another process {total.moves} times")
    print(f"rounds in which something was wrong: {failed}")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
