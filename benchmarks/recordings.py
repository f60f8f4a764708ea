"""Many recordings judged by one process and by several, in the same run: events a second, the ratio, and their memory.

python benchmarks/recordings.py [recordings] [events] [jobs]
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from statistics import median

from replay import SPEC, write

ROUNDS = 3


class Memory:
    """The most memory that any worker of a process has had (KiB), looked at ten times a second."""

    def __init__(self, process: int) -> None:
        self.most = 0
        self._process, self._ended = process, threading.Event()
        self._thread = threading.Thread(target=self._look)
        self._thread.start()

    def _look(self) -> None:
        while not self._ended.wait(0.1):
            for task in Path(f"/proc/{self._process}/task").glob("*/children"):
                for child in task.read_text().split():
                    self.most = max(self.most, _peak(child))

    def end(self) -> int:
        self._ended.set()
        self._thread.join()
        return self.most


def _peak(process: str) -> int:
    """The most memory of a process that judges, 0 of any other."""
    try:
        if b"spawn_main" not in Path(f"/proc/{process}/cmdline").read_bytes():
            return 0
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("VmHWM")), 0)


def run(folder: Path, jobs: int | None) -> tuple[float, int]:
    """Seconds, and the most memory of a worker; without `jobs` each recording by a `replay` of its own process."""
    command = str(Path(sys.executable).with_name("oracle-server"))
    spec, bags = folder / "spec.yaml", sorted((folder / "bags").iterdir())
    start = time.perf_counter()
    if jobs is None:
        code = (
            "import sys; from pathlib import Path; from oracle_server.replay.command import run_replay\n"
            "from oracle_server.process.garbage import collect_rarely\n"
            "collect_rarely()\n"
            "for bag in sys.argv[2:]: run_replay([Path(sys.argv[1])], Path(bag), None, 'text')\n"
        )
        words = [sys.executable, "-c", code, str(spec), *map(str, bags)]
    else:
        words = [command, "replay", str(folder / "bags"), "--on", str(spec), "-j", str(jobs)]
        words += ["--out", str(folder / f"results{time.time_ns()}.jsonl")]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    memory = Memory(process.pid)
    process.wait()
    return time.perf_counter() - start, memory.end()


def main() -> None:
    recordings, events, jobs = (int(word) for word in (*sys.argv[1:], *("40", "20000", "2")[len(sys.argv) - 1 :]))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "spec.yaml").write_text(SPEC)
        (folder / "bags").mkdir()
        for i in range(recordings):
            write(folder / "bags" / f"b{i:03}", events)
        rounds = [(run(folder, None)[0], run(folder, 1), run(folder, jobs)) for _ in range(ROUNDS)]
    all_events = recordings * events
    print(json.dumps({
        "recordings": recordings, "events": all_events, "jobs": jobs,
        "serial_per_second": round(all_events / median(serial for serial, _, _ in rounds)),
        "one_per_second": round(all_events / median(one for _, (one, _), _ in rounds)),
        "jobs_per_second": round(all_events / median(several for _, _, (several, _) in rounds)),
        "ratio_to_serial": round(median(serial / several for serial, _, (several, _) in rounds), 2),
        "ratio_to_one": round(median(one / several for _, (one, _), (several, _) in rounds), 2),
        "worker_mib": round(max(most for _, one, several in rounds for most in (one[1], several[1])) / 1024),
    }))  # fmt: skip


if __name__ == "__main__":
    main()
