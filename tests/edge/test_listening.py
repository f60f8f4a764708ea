"""A UNIX socket is made for its user alone, replaced where nobody listens at it, and deleted by who made it.

Why a port can't be had is told with what to do.
"""

from __future__ import annotations

import errno
import os
import socket
import stat
from pathlib import Path

import pytest

from oracle_server.edge.listening import ListenError, listen, listening_unix
from oracle_server.edge.visitors import Visitors


def left_behind(path: Path) -> None:
    """A socket as a killed process leaves it."""
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


def test_it_is_for_its_user_alone_and_gone_afterwards(tmp_path: Path) -> None:
    path = tmp_path / "s"
    with listening_unix(path, Visitors(10)):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        with socket.socket(socket.AF_UNIX) as client:
            client.connect(str(path))
    assert not path.exists()
    with listening_unix(None, Visitors(10)) as nothing:
        assert nothing is None


def test_what_was_left_behind_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "s"
    left_behind(path)
    with listening_unix(path, Visitors(10)), socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))


def test_where_somebody_listens_it_is_refused_and_left(tmp_path: Path) -> None:
    path = tmp_path / "s"
    with listening_unix(path, Visitors(10)):
        with pytest.raises(ListenError, match="another process listens there"), listening_unix(path, Visitors(10)):
            pass
        with socket.socket(socket.AF_UNIX) as client:
            client.connect(str(path))


def test_where_too_many_wait_somebody_listens(tmp_path: Path) -> None:
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX) as busy, socket.socket(socket.AF_UNIX) as first:
        busy.bind(str(path))
        busy.listen(0)
        first.connect(str(path))
        with pytest.raises(ListenError, match="another process listens there"), listening_unix(path, Visitors(10)):
            pass
    assert path.is_socket()


def test_what_is_no_socket_is_refused_and_left(tmp_path: Path) -> None:
    plain, link = tmp_path / "plain", tmp_path / "link"
    plain.write_text("kept")
    left_behind(tmp_path / "s")
    link.symlink_to(tmp_path / "s")
    for path in (plain, link, tmp_path):
        with pytest.raises(ListenError, match="is there, and no socket"), listening_unix(path, Visitors(10)):
            pass
    assert plain.read_text() == "kept"
    assert link.is_symlink()


@pytest.mark.parametrize("name", ["x" * 120, "nowhere/s"])
def test_where_none_can_be_made_it_is_said(tmp_path: Path, name: str) -> None:
    with (
        pytest.raises(ListenError, match="can't be used as a UNIX socket: "),
        listening_unix(tmp_path / name, Visitors(10)),
    ):
        pass


def test_one_that_another_process_has_put_in_its_place_is_left(tmp_path: Path) -> None:
    path = tmp_path / "s"
    with listening_unix(path, Visitors(10)):
        path.rename(tmp_path / "t")  # its number is not given to another file
        left_behind(path)
    assert path.is_socket()


@pytest.mark.parametrize(
    ("number", "hint"),
    [(errno.EADDRINUSE, "stop what uses it, or choose another --port"),
     (errno.EACCES, "ports below 1024 are the system's: choose another --port")],
)  # fmt: skip
def test_a_port_that_can_not_be_had_is_told_with_what_to_do(
    number: int, hint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("oracle_server.edge.listening.Listener.bind", refuse)
    with pytest.raises(ListenError) as refused:
        listen("::1", 80, Visitors(10))
    assert str(refused.value) == f"[::1]:80: {os.strerror(number)}; {hint}"
