"""The server's certificate: it is read anew where its files change, since a renewed one must not need a restart."""

from __future__ import annotations

import asyncio
import contextlib
import ssl
from pathlib import Path
from typing import Any

import structlog

from oracle_server.core.errors import OracleError

_LOOKS_AFTER = 10.0
"""Seconds between two looks at the files."""

_Stand = list[tuple[int, int, int]] | None
"""What tells the files from others, None where one is missing."""

log = structlog.get_logger()


class CertificateError(OracleError):
    """Certificates that can't be used."""


class _Context(ssl.SSLContext):
    """Its connections are the present context's: no session of one before is resumed, for which nobody was asked."""

    present: ssl.SSLContext

    def wrap_bio(self, *given: Any, **named: Any) -> ssl.SSLObject:
        """Begin a connection, with the present context."""
        return self.present.wrap_bio(*given, **named)


class Certificates:
    """A server's TLS context, whose handshakes are made with what its files hold by then."""

    def __init__(self, cert: Path, key: Path, client_ca: Path | None) -> None:
        """Take a certificate and its key, and the authority of clients' certificates, where these must show one.

        Raises `CertificateError` where they can't be used.
        """
        self._cert, self._key, self._client_ca = cert, key, client_ca
        self._files = [file for file in (cert, key, client_ca) if file]
        self._taken = self._seen = self._stand()
        self._trouble: str | None = None
        """Why what the files hold can't be used, as the log says."""
        self.context = _Context(ssl.PROTOCOL_TLS_SERVER)
        try:
            self.context.present = self._read()
        except OSError as error:
            raise CertificateError(f"{self._named}: can't be used for TLS: {error.strerror or error}") from None

    async def watch(self) -> None:
        """Look at the files again and again, for as long as this runs."""
        while True:
            await asyncio.sleep(_LOOKS_AFTER)
            self.look()

    def look(self) -> None:
        """Take what the files hold now, where that is new, and was so at the last look: they change one by one.

        What can't be used is tried again with each look: who may read a file may change without it.
        """
        stand, before = self._stand(), self._seen
        self._seen = stand
        if stand != before:
            return
        if stand == self._taken:
            self._trouble = None
            return
        try:
            self.context.present = self._read(password="")  # nobody is asked for one
        except OSError as error:
            reason = error.strerror or str(error)
            if reason != self._trouble:
                what = "TLS goes on with the certificate of before: the new one is bad"
                log.error(what, file=self._named, reason=reason)
            self._trouble = reason
        else:
            self._taken, self._trouble = stand, None
            log.info("TLS goes on with a new certificate", file=str(self._cert))

    def _read(self, password: str | None = None) -> ssl.SSLContext:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.load_cert_chain(self._cert, self._key, password)
        if self._client_ca:
            context.load_verify_locations(self._client_ca)
            context.verify_mode = ssl.CERT_REQUIRED
        return context

    def _stand(self) -> _Stand:
        with contextlib.suppress(OSError):
            return [(at.st_ino, at.st_size, at.st_mtime_ns) for at in (file.stat() for file in self._files)]
        return None

    @property
    def _named(self) -> str:
        return ", ".join(map(str, self._files))
