"""TLS: who may reach the server from elsewhere, and how."""

from __future__ import annotations

import asyncio
import json
import queue
import ssl
import time
from collections.abc import Sequence
from pathlib import Path

import httpx
import pytest
import trustme
from oracle_adapter import Link, LinkError
from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

from oracle_server.edge.tokens import add
from tests.chaos.served import Served
from tests.whole.client import make_attach
from tests.whole.conftest import Starts, copy_specs
from tests.whole.harness import PATIENCE, Server, failed, problem, run
from tests.whole.test_disk import locked


class Authority:
    """An authority with a server's certificate and a client's, as files."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        authority, stranger = trustme.CA(), trustme.CA()
        self.ca = folder / "ca.pem"
        authority.cert_pem.write_to_path(self.ca)
        self.server = self._issue(authority, folder / "server", "127.0.0.1")
        self.client = self._issue(authority, folder / "client", "robot")
        self.stranger = self._issue(stranger, folder / "stranger", "robot")

    @property
    def settings(self) -> dict[str, str]:
        return {"ORACLE_TLS_CERT": str(self.server[0]), "ORACLE_TLS_KEY": str(self.server[1])}

    def context(self, own: tuple[Path, Path] | None = None) -> ssl.SSLContext:
        context = ssl.create_default_context(cafile=str(self.ca))
        if own:
            context.load_cert_chain(*own)
        return context

    @staticmethod
    def _issue(authority: trustme.CA, stem: Path, name: str) -> tuple[Path, Path]:
        issued = authority.issue_cert(name)
        files = stem.with_suffix(".crt"), stem.with_suffix(".key")
        issued.cert_chain_pems[0].write_to_path(files[0])
        issued.private_key_pem.write_to_path(files[1])
        return files


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority(tmp_path_factory.mktemp("tls") / "pki")


def ask(server: Server, context: ssl.SSLContext) -> int:
    with httpx.Client(verify=context, trust_env=False, timeout=PATIENCE) as http:
        return http.get(f"{server.url}/api/v1/sessions").status_code


async def test_all_goes_over_tls(start: Starts, authority: Authority) -> None:
    server = start(**authority.settings)
    assert server.url.startswith("https://")
    assert ask(server, authority.context()) == 200
    with pytest.raises(httpx.ConnectError):
        ask(server, ssl.create_default_context())
    with pytest.raises(httpx.HTTPError):
        httpx.get(server.url.replace("https", "http") + "/healthz", trust_env=False, timeout=PATIENCE)
    assert "CERTIFICATE_VERIFY_FAILED" in failed("sessions", "--url", server.url)
    assert run("sessions", "--url", server.url, ORACLE_CA=str(authority.ca)).returncode == 0
    wanted = {"spec": "single", "session": "s", "tls": authority.context()}
    with Link(server.url, "m1", **wanted) as link:  # type: ignore[arg-type]
        assert link.wait_attached(PATIENCE).session == "s"


async def test_how_it_is_is_told_over_tls_too(start: Starts, authority: Authority) -> None:
    server = start(**authority.settings)
    status = ("status", "--data-dir", server.data, "--ready")
    told = run(*status)
    assert (told.returncode, told.stdout.split(": ")[1].split(" (")[0]) == (0, "ready")
    with locked(server), httpx.Client(verify=authority.context(), trust_env=False, timeout=PATIENCE) as http:
        wanted = {"spec": "single", "id": "s"}
        problem(await asyncio.to_thread(http.post, f"{server.url}/api/v1/sessions", json=wanted), 503)
        told = run(*status)
        assert (told.returncode, told.stdout.split(": ")[1].split(" (")[0]) == (3, "not ready")
    server.stop()
    server = start(**authority.settings, ORACLE_TLS_CLIENT_CA=str(authority.ca))
    assert ": running (" in run(*status).stdout, "it does not answer without a certificate"


async def test_a_client_without_a_good_certificate_is_refused(start: Starts, authority: Authority) -> None:
    server = start(**authority.settings, ORACLE_TLS_CLIENT_CA=str(authority.ca))
    url = server.url.replace("https", "wss", 1) + "/api/v1/attach"
    for own in (None, authority.stranger):
        with pytest.raises((httpx.HTTPError, ssl.SSLError)):
            ask(server, authority.context(own))
        with pytest.raises((OSError, WebSocketException)):
            await attach(url, authority.context(own))
    assert ask(server, authority.context(authority.client)) == 200
    assert (await attach(url, authority.context(authority.client)))["type"] == "attached"
    client, key = authority.client
    own_files = {"ORACLE_CA": str(authority.ca), "ORACLE_CLIENT_CERT": str(client), "ORACLE_CLIENT_KEY": str(key)}
    assert run("sessions", "--url", server.url, **own_files).returncode == 0


async def test_a_link_takes_its_own_certificate_anew(
    start: Starts, authority: Authority, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a robot that runs for longer than its certificate would have to be started again."""
    server = start(**authority.settings, ORACLE_TLS_CLIENT_CA=str(authority.ca))
    files = tmp_path / "own.crt", tmp_path / "own.key"

    def put(pair: Sequence[Path]) -> None:
        for source, target in zip(pair, files, strict=True):
            target.with_suffix(".new").write_bytes(source.read_bytes())
            target.with_suffix(".new").replace(target)

    put(authority.stranger)
    for name, value in zip(("CA", "CLIENT_CERT", "CLIENT_KEY"), (authority.ca, *files), strict=True):
        monkeypatch.setenv(f"ORACLE_{name}", str(value))
    errors: queue.Queue[LinkError] = queue.Queue()
    with Link(server.url, "m1", spec="single", session="s", on_error=errors.put) as link:
        assert not errors.get(timeout=PATIENCE).fatal
        files[1].write_text("half of it")  # they change one by one
        put(authority.client)
        assert link.wait_attached(PATIENCE).session == "s"


async def attach(url: str, context: ssl.SSLContext) -> dict[str, object]:
    async with connect(url, ssl=context, proxy=None, open_timeout=PATIENCE) as socket, asyncio.timeout(PATIENCE):
        await socket.send(json.dumps(make_attach(spec="single")))
        answer: dict[str, object] = json.loads(await socket.recv())
        return answer


async def test_a_connection_over_tls_that_has_ended_is_let_go_of(authority: Authority, tmp_path: Path) -> None:
    prelude = "from oracle_server.edge import transport; transport._CLOSE_WITHIN = 0.05"
    cert, key = map(str, authority.server)
    specs = copy_specs(tmp_path / "specs")
    async with Served(specs, tmp_path / "data", prelude, tls_cert=cert, tls_key=key) as served:
        url = f"wss://127.0.0.1:{served.port}/api/v1/attach"
        begin = time.monotonic()
        while time.monotonic() < begin + 0.5:
            assert (await attach(url, authority.context()))["type"] == "attached"
        assert await served.stop() == 0
    assert not served.complaints


async def test_old_tls_is_refused(start: Starts, authority: Authority) -> None:
    server = start(**authority.settings)
    context = authority.context()
    context.minimum_version = ssl.TLSVersion.MINIMUM_SUPPORTED
    with pytest.warns(DeprecationWarning, match="TLS"):
        context.maximum_version = ssl.TLSVersion.TLSv1_1
    with pytest.raises(httpx.HTTPError):
        ask(server, context)


def test_nobody_is_let_in_from_elsewhere_by_mistake(tmp_path: Path, authority: Authority) -> None:
    data, open_to_all = tmp_path / "data", ("serve", "--host", "0.0.0.0", "--port", "0", "--data-dir")
    message = failed(*open_to_all, data)
    assert "token" in message
    assert "TLS" in message
    assert "--insecure" in message
    message = failed(*open_to_all, data, **authority.settings)
    assert "a token" in message
    assert "TLS would" not in message
    add(data / "tokens.json", "a", ["admin"])
    assert "TLS would be missing" in failed(*open_to_all, data)
    for host in ("::", "192.0.2.1", "robot.local"):
        assert "--insecure" in failed("start", "--host", host, "--port", "0", "--data-dir", data)


def test_certificates_that_can_not_be_used_are_told(tmp_path: Path, authority: Authority) -> None:
    cert, key = map(str, authority.server)
    serve = ("serve", "--port", "0", "--data-dir", tmp_path / "data")
    assert "nowhere.pem" in failed(*serve, ORACLE_TLS_CERT=str(tmp_path / "nowhere.pem"), ORACLE_TLS_KEY=key)
    assert "can't be used for TLS" in failed(*serve, ORACLE_TLS_CERT=key, ORACLE_TLS_KEY=key)
    assert "both" in failed(*serve, ORACLE_TLS_CERT=cert)
    wrong = {"ORACLE_TLS_CERT": cert, "ORACLE_TLS_KEY": str(authority.client[1])}
    assert "can't be used for TLS" in failed(*serve, **wrong)


@pytest.mark.parametrize("protected", [True, False])
async def test_a_bind_to_all_addresses(start: Starts, authority: Authority, tmp_path: Path, protected: bool) -> None:
    settings, secret = {"ORACLE_INSECURE": "true"}, ""
    if protected:
        secret = add(tmp_path / "data" / "tokens.json", "a", ["admin"])
        settings = authority.settings
    server = start(
        ORACLE_HOST="0.0.0.0", ORACLE_ALLOWED_HOSTS="oracle.local, https://Other.local:443/, [fd00::1]:1", **settings
    )
    assert ("without protection" in server.log) is not protected
    url = server.url.replace("0.0.0.0", "127.0.0.1")
    headers = {"Authorization": f"Bearer {secret}"} if protected else {}
    with httpx.Client(
        verify=authority.context(), trust_env=False, headers=headers, base_url=url, timeout=PATIENCE
    ) as http:
        assert http.get("/api/v1/sessions").status_code == 200
        for name in ("oracle.local", "oracle.local:8642", "other.local", "[fd00::1]:8642"):
            assert http.get("/api/v1/sessions", headers={"Host": name}).status_code == 200, name
        assert http.get("/api/v1/sessions", headers={"Host": "evil.local"}).status_code == 421
