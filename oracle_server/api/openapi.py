"""The API as it is described at /openapi.json: `python -m oracle_server.api.openapi > docs/openapi.json`."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from oracle_server.api.app import build_app
from oracle_server.history.sqlite.store import Store
from oracle_server.process.clock import Clock
from oracle_server.process.watchdog import Watchdog
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library


def description() -> dict[str, Any]:
    """The OpenAPI document of a server without specs."""
    with tempfile.TemporaryDirectory() as folder:
        store, library = Store(Path(folder)), Library(None, Path(folder))
        try:
            return build_app(Registry(store, library, Clock(), 10.0), library, store, Watchdog()).openapi()
        finally:
            store.close()


if __name__ == "__main__":
    json.dump(description(), sys.stdout, indent=2, sort_keys=True)
    sys.stdout.write("\n")
