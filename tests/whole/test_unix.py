"""A server that listens at a UNIX socket, too."""

from __future__ import annotations

import signal
import stat
from pathlib import Path

import pytest
import trustme
from oracle_adapter import Link, LinkError

from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, failed, run


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "oracle.sock"


def decided(url: str, session: str, token: str | None = None) -> str | None:
    """What a monitor is told at an address."""
    with Link(url, "lamp1", spec="single", session=session, streams=["/a"], token=token) as link:
        link.wait_attached(PATIENCE)
        return link.ask("/a", "topic", None, {"v": 1}, decide_within=PATIENCE).result(PATIENCE).decision


def test_monitors_and_commands_reach_it_there(start: Starts, path: Path) -> None:
    server = start(ORACLE_UNIX=str(path))
    server.said("accepting work at a UNIX socket")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert decided(f"unix://{path}", "s1") == decided(server.url, "s2") == "allow"
    listed = run("sessions", "--url", f"unix://{path}")
    assert listed.returncode == 0, listed.stderr
    assert "s1" in listed.stdout
    assert server.stop() == 0
    assert not path.exists()
    assert "can't be reached" in failed("sessions", "--url", f"unix://{path}")


def test_tokens_are_asked_for_and_tls_is_not(start: Starts, path: Path, tmp_path: Path) -> None:
    authority = trustme.CA()
    certificate = authority.issue_cert("127.0.0.1")
    certificate.private_key_pem.write_to_path(str(tmp_path / "key.pem"))
    certificate.cert_chain_pems[0].write_to_path(str(tmp_path / "cert.pem"))
    token = run("token", "add", "robot", "--scope", "submit", "--data-dir", tmp_path / "data").stdout.split()[-1]
    tls = {"ORACLE_TLS_CERT": str(tmp_path / "cert.pem"), "ORACLE_TLS_KEY": str(tmp_path / "key.pem")}
    server = start(ORACLE_UNIX=str(path), **tls)
    server.said("accepting work at a UNIX socket")
    with pytest.raises(LinkError, match="HTTP 401") as refused:
        decided(f"unix://{path}", "s1")
    assert refused.value.fatal
    assert decided(f"unix://{path}", "s1", token) == "allow"


def test_a_server_goes_on_where_a_killed_one_left_it(start: Starts, path: Path) -> None:
    start(ORACLE_UNIX=str(path)).stop(signal.SIGKILL)
    assert path.is_socket()
    start(ORACLE_UNIX=str(path)).said("accepting work at a UNIX socket")
    assert decided(f"unix://{path}", "s1") == "allow"
