"""Whoever started the process is told how it stands, and can't hold it up."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from oracle_server.process.notify import notify


def test_who_listens_and_takes_nothing_holds_nothing_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room = int(Path("/proc/sys/net/unix/max_dgram_qlen").read_text()) + 1
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        for _ in range(room + 1):
            notify("WATCHDOG=1")
        assert listener.recv(100) == b"WATCHDOG=1"
