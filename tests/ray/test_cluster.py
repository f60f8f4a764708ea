"""Recordings judged on a Ray cluster of two nodes, both of this machine."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from ray.cluster_utils import Cluster

from oracle_server.replay.many.tablefile import read_rows
from tests.processes import SERVER
from tests.replay.many.recordings import write_recordings, write_specs

PATIENCE = 400


@pytest.fixture
def address() -> Iterator[str]:
    """The address of a cluster with a core on each of two nodes."""
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    try:
        cluster.add_node(num_cpus=1)
        yield cluster.address
    finally:
        cluster.shutdown()  # type: ignore[no-untyped-call]


def test_it_comes_to_the_same_as_processes(tmp_path: Path, address: str) -> None:
    specs = write_specs(tmp_path)
    write_recordings(tmp_path / "recordings", 20)
    for engine in ("local", "ray"):
        ended = subprocess.run(
            [SERVER, "replay", "recordings", "--on", *specs, "--out", f"{engine}.parquet", "--engine", engine],
            cwd=tmp_path, env={**os.environ, "RAY_ADDRESS": address}, capture_output=True, text=True,
            timeout=PATIENCE, check=False,
        )  # fmt: skip
        assert ended.returncode == 2, ended.stderr
    rows = [list(read_rows(tmp_path / f"{engine}.parquet")) for engine in ("local", "ray")]
    assert rows[0] == rows[1]
    assert len(rows[0]) == 60
