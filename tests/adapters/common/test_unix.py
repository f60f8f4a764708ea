"""A link to a server at a UNIX socket."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from pathlib import Path
from typing import Iterator, List

import pytest
from oracle_adapter import Link
from tests.adapters.common.conftest import News, Oracle, Peer
from tests.adapters.common.links import PATIENCE, QUICK, answer_of, ask


class AtSocket(Oracle):
    """A server at a path; where it is broken, the socket stays behind."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path

    @property
    def url(self) -> str:
        return f"unix://{self.path}"

    async def _serve(self) -> asyncio.AbstractServer:
        loop = self._loop
        with suppress(FileNotFoundError):
            self.path.unlink()
        return await loop.create_unix_server(lambda: Peer(self, loop), str(self.path))


@pytest.fixture
def oracle(tmp_path: Path) -> Iterator[AtSocket]:
    oracle = AtSocket(tmp_path / "oracle.sock")
    yield oracle
    oracle.end()


def test_it_asks_and_goes_on_where_the_server_comes_back(
    oracle: AtSocket, news: News, links: List[Link]
) -> None:
    links.append(Link(oracle.url, "uav1", token="secret", timing=QUICK, **news.callbacks()))
    links[0].start()
    assert str(oracle.path) in str(news.error())  # nobody is there yet
    oracle.start()
    peer = oracle.accept()
    peer.attach()
    request = oracle.requests.get(timeout=PATIENCE)
    assert request.path == "/api/v1/attach"
    assert request.headers["Host"] == "localhost"
    assert request.headers["Authorization"] == "Bearer secret"
    asked = ask(links[0])
    (event,) = peer.events(1)
    peer.send("decision", seq=event["seq"], decision="deny", denied_by=["p"], verdicts={})
    assert answer_of(asked).decision == "deny"
    oracle.stop()
    again = ask(links[0])
    oracle.start()
    peer = oracle.accept()
    peer.attach(upcoming=1)
    seqs = [event["seq"] for event in peer.events(2)]
    assert seqs == [1, 2]
    peer.send("decision", seq=2, decision="allow", denied_by=[], verdicts={})
    assert answer_of(again).decision == "allow"


@pytest.mark.parametrize("url", ["unix://", "unix://here/oracle.sock"])
def test_what_is_no_path_is_refused_at_once(url: str) -> None:
    with pytest.raises(ValueError, match="no address like unix:///"):
        Link(url, "uav1")
