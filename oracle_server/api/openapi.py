"""Writes the API's description, which docs/openapi.json holds: `python -m oracle_server.api.openapi`."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from oracle_server.api.app import build_app
from oracle_server.history.memory import MemoryHistory
from oracle_server.jobs.checking import Checking
from oracle_server.jobs.recordings import Recordings
from oracle_server.jobs.uploads import Uploads
from oracle_server.process.clock import Clock
from oracle_server.process.watchdog import Watchdog
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library


def description() -> dict[str, Any]:
    """The OpenAPI document of a server without specs."""
    with tempfile.TemporaryDirectory() as folder:
        history, library = MemoryHistory(), Library(None, Path(folder))
        registry = Registry(history, library, Clock(), 10.0)
        sent = Recordings(registry, library, Uploads(Path(folder) / "recordings", 0))
        return build_app(registry, library, history, Watchdog(), Checking(), sent).openapi()


if __name__ == "__main__":
    json.dump(description(), sys.stdout, indent=2, sort_keys=True)
    sys.stdout.write("\n")
