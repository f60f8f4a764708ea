"""How many rows a second a robot's history is forwarded to PostgreSQL.

python benchmarks/forwarding.py [--url postgresql://USER@HOST/EMPTY_DATABASE] [--rows 100000] [--folder /tmp]

Without `--url` a PostgreSQL of Debian's packages is started for it. The rows are those of `timeline.py`; no server
writes meanwhile. Beside the rate stands its ratio to 10,000 rows a second, which is asked of it.
"""

from __future__ import annotations

import argparse
import asyncio
import tempfile
import time
from pathlib import Path

from database import database
from timeline import filled

from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.jobs.forwarding import Forwarding

WANTED = 10_000
"""Rows a second."""


async def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url")
    parser.add_argument("--rows", type=int, default=100_000)
    parser.add_argument("--folder")
    asked = parser.parse_args()
    with database(asked.url) as url, tempfile.TemporaryDirectory(dir=asked.folder) as name:
        folder = Path(name)
        filled(folder, asked.rows)
        history = SqliteHistory(folder, forwarding=True)
        history.start(asyncio.get_running_loop())
        assert history.forwarding is not None
        forwarding = Forwarding(history.forwarding, url, "robot")
        running = asyncio.create_task(forwarding.run())
        while not forwarding.progress.rows:
            await asyncio.sleep(0.001)
        begun, first = time.perf_counter(), forwarding.progress.rows
        while forwarding.progress.left:
            await asyncio.sleep(0.001)
        took, count = time.perf_counter() - begun, forwarding.progress.rows - first
        print(f"forwarded: {count / took:,.0f} rows/s, {count / took / WANTED:.2f} of what is asked")
        running.cancel()
        await asyncio.wait([running])
        forwarding.close()
        await asyncio.to_thread(history.close)


if __name__ == "__main__":
    asyncio.run(main())
