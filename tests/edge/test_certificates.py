"""A certificate that is renewed is used without a restart."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import socket
import ssl
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
import trustme

from oracle_server.edge.certificates import CertificateError, Certificates
from tests.processes import PATIENCE

Pair = tuple[Path, Path]


class Files:
    """The files that a server is told of, and those that are put in their places."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._count = folder, 0
        self.cert, self.key, self.client_ca = folder / "server.crt", folder / "server.key", folder / "clients.pem"

    def issued(self, authority: trustme.CA, name: str = "127.0.0.1", *, kind: str = "ECDSA") -> Pair:
        self._count += 1
        issued = authority.issue_cert(name, key_type=trustme.KeyType[kind])
        cert, key = self._folder / f"{self._count}.crt", self._folder / f"{self._count}.key"
        issued.cert_chain_pems[0].write_to_path(cert)
        issued.private_key_pem.write_to_path(key)
        return cert, key

    def put(self, cert: Path | None, key: Path | None) -> None:
        for source, target in ((cert, self.cert), (key, self.key)):
            if source is not None:
                new = target.with_suffix(".new")
                shutil.copy(source, new)
                new.replace(target)


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


@contextlib.asynccontextmanager
async def serving(certificates: Certificates) -> AsyncIterator[int]:
    """A server that greets and closes, at a port."""

    async def greet(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"hello")
        writer.close()

    async with await asyncio.start_server(greet, "127.0.0.1", 0, ssl=certificates.context) as server:
        yield server.sockets[0].getsockname()[1]


async def shown(port: int, authority: trustme.CA, own: Pair | None = None, name: str | None = None) -> bytes:
    """The certificate that a server shows who knows an authority, by an address or by a name."""
    context = ssl.create_default_context()
    authority.configure_trust(context)
    context.check_hostname = False
    if own is not None:
        context.load_cert_chain(*own)
    async with asyncio.timeout(PATIENCE):
        reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context, server_hostname=name or "")
        try:
            found: bytes = writer.get_extra_info("ssl_object").getpeercert(binary_form=True)
            if await reader.read() != b"hello":
                raise ConnectionError
        finally:
            writer.close()
    return found


def der(cert: Path) -> bytes:
    return ssl.PEM_cert_to_DER_cert(cert.read_text(encoding="ascii"))


@pytest.mark.parametrize("name", [None, "robot.example"])
async def test_what_was_renewed_is_shown_to_who_comes_next(files: Files, name: str | None) -> None:
    authority = trustme.CA()
    old, new = files.issued(authority, kind="RSA"), files.issued(authority)
    files.put(*old)
    certificates = Certificates(files.cert, files.key, None)
    async with serving(certificates) as port:
        assert await shown(port, authority, name=name) == der(old[0])
        files.put(*new)
        certificates.look()
        assert await shown(port, authority, name=name) == der(old[0]), "it may change yet"
        certificates.look()
        assert await shown(port, authority, name=name) == der(new[0])


async def test_what_can_not_be_used_is_not_and_is_told_once(files: Files, capsys: pytest.CaptureFixture[str]) -> None:
    authority = trustme.CA()
    old, new = files.issued(authority), files.issued(authority)
    files.put(*old)
    certificates = Certificates(files.cert, files.key, None)
    async with serving(certificates) as port:
        files.put(new[0], None)
        for _ in range(4):
            certificates.look()
        assert await shown(port, authority) == der(old[0]), "its key is missing yet"
        assert capsys.readouterr().out.count("certificate of before") == 1
        files.key.unlink()
        certificates.look()
        assert "certificate of before" not in capsys.readouterr().out
        for _ in range(4):
            certificates.look()
        assert capsys.readouterr().out.count("No such file") == 1
        files.put(None, new[1])
        for _ in range(2):
            certificates.look()
        assert await shown(port, authority) == der(new[0])


async def test_what_may_be_read_only_later_is_taken_then(files: Files, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a renewed key is its owner's alone until a hook lets the server's user read it: no file changes then."""
    authority = trustme.CA()
    old, new = files.issued(authority), files.issued(authority)
    files.put(*old)
    certificates = Certificates(files.cert, files.key, None)

    def refused(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    async with serving(certificates) as port:
        files.put(*new)
        with monkeypatch.context() as forbidden:
            forbidden.setattr(ssl.SSLContext, "load_cert_chain", refused)
            for _ in range(2):
                certificates.look()
        assert await shown(port, authority) == der(old[0])
        certificates.look()
        assert await shown(port, authority) == der(new[0])


async def test_who_showed_a_certificate_of_an_authority_that_is_none_any_more_can_not_go_on_with_that(
    files: Files,
) -> None:
    """By TLS 1.2 a session that is resumed is one for which nobody is asked for a certificate again."""
    authority, first, second = trustme.CA(), trustme.CA(), trustme.CA()
    files.put(*files.issued(authority))
    first.cert_pem.write_to_path(files.client_ca)
    certificates = Certificates(files.cert, files.key, files.client_ca)
    context = ssl.create_default_context()
    authority.configure_trust(context)
    context.check_hostname, context.maximum_version = False, ssl.TLSVersion.TLSv1_2
    context.load_cert_chain(*files.issued(first, "robot"))

    def connected(session: ssl.SSLSession | None) -> tuple[bool, ssl.SSLSession | None]:
        with (
            socket.create_connection(("127.0.0.1", port), PATIENCE) as plain,
            context.wrap_socket(plain, session=session) as encrypted,
        ):
            assert encrypted.recv(5) == b"hello"
            return bool(encrypted.session_reused), encrypted.session

    async with serving(certificates) as port:
        _, session = await asyncio.to_thread(connected, None)
        assert session is not None
        assert (await asyncio.to_thread(connected, session))[0]
        files.client_ca.unlink()
        second.cert_pem.write_to_path(files.client_ca)
        for _ in range(2):
            certificates.look()
        with pytest.raises((ssl.SSLError, ConnectionError)):
            await asyncio.to_thread(connected, session)


async def test_another_authority_of_clients_is_the_only_one_then(files: Files) -> None:
    authority, first, second = trustme.CA(), trustme.CA(), trustme.CA()
    files.put(*files.issued(authority))
    clients = files.issued(first, "robot"), files.issued(second, "robot")
    first.cert_pem.write_to_path(files.client_ca)
    certificates = Certificates(files.cert, files.key, files.client_ca)

    async def let_in() -> list[bool]:
        found = []
        for own in clients:
            with contextlib.suppress(ssl.SSLError, ConnectionError):
                await shown(port, authority, own)
                found.append(own)
        return [own in found for own in clients]

    async with serving(certificates) as port:
        assert await let_in() == [True, False]
        files.client_ca.unlink()
        second.cert_pem.write_to_path(files.client_ca)
        for _ in range(2):
            certificates.look()
        assert await let_in() == [False, True]


def test_what_can_not_be_used_from_the_beginning_is_refused(files: Files) -> None:
    with pytest.raises(CertificateError, match=r"server.crt, .*server.key: can't be used for TLS: No such file"):
        Certificates(files.cert, files.key, None)


async def test_files_are_looked_at_again_and_again(files: Files, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("oracle_server.edge.certificates._LOOKS_AFTER", 0.001)
    authority = trustme.CA()
    files.put(*files.issued(authority))
    certificates = Certificates(files.cert, files.key, None)
    new = files.issued(authority)
    with watched(certificates):
        async with serving(certificates) as port, asyncio.timeout(PATIENCE):
            files.put(*new)
            while await shown(port, authority) != der(new[0]):
                pass


@contextlib.contextmanager
def watched(certificates: Certificates) -> Iterator[None]:
    task = asyncio.create_task(certificates.watch())
    try:
        yield
    finally:
        task.cancel()
