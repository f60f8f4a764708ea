"""The command `put`: stores specs in a running server."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from oracle_server.cli.client import Client
from oracle_server.core.errors import one_line
from oracle_server.specfiles.load import load_spec

_WITHIN = 120.0
"""Seconds for a spec to be checked and stored; large ones take a few."""


def put_specs(client: Client, paths: Sequence[Path]) -> None:
    """Store specs, and print what the server keeps, and finds doubtful in it.

    Raises `SpecError` before anything is stored where one is unsound, and `ServerUnreachableError`.
    """
    for path, spec in [(path, load_spec(path).spec) for path in paths]:
        kept = client.put(f"specs/{spec.id}", path.read_bytes(), _WITHIN)
        sys.stderr.writelines(f"{one_line(warning)}\n" for warning in kept["warnings"])
        sys.stdout.write(f"{path}: stored as {kept['id']}; open sessions keep theirs\n")
