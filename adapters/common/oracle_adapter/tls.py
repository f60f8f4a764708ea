"""TLS for a link that is given none: by environment variables, so that adapters need no options."""

from __future__ import annotations

import os
import ssl
from contextlib import suppress
from typing import List, Mapping, Optional

from oracle_adapter import logs


class Renewed:
    """A context by the files that an environment names, made anew once these have changed.

    A certificate is renewed every few weeks, and a robot may run for longer.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        """As `context_from`. Raises `ValueError`."""
        self._environment = dict(environment)
        self._taken = self._stand()
        self._context = context_from(self._environment)
        self._trouble = ""

    def context(self) -> ssl.SSLContext:
        """For the next connection; that of before where what the files hold now can't be used."""
        stand = self._stand()
        if stand != self._taken:
            try:
                self._context, self._taken = context_from(self._environment), stand
                self._trouble = ""
            except ValueError as error:  # they change one by one
                if str(error) != self._trouble:
                    logs.warn("TLS goes on with the certificate of before: %s", error)
                self._trouble = str(error)
        return self._context

    def _stand(self) -> object:
        """What tells the files from others; None where one is missing."""
        with suppress(OSError):
            found = [os.stat(file) for file in _files(self._environment) if file]
            return [(at.st_ino, at.st_size, at.st_mtime_ns) for at in found]
        return None


def context_from(environment: Mapping[str, str]) -> ssl.SSLContext:
    """By `ORACLE_CA`, or the system's authorities; with `ORACLE_CLIENT_CERT`, `ORACLE_CLIENT_KEY`.

    Raises `ValueError` where a file can't be used, such as a key with a password.
    """
    asked = False

    def no_password() -> str:  # without it OpenSSL asks on the terminal, and waits for an answer
        nonlocal asked
        asked = True
        return ""

    files = _files(environment)
    authority, certificate, key = files
    try:
        context = ssl.create_default_context(cafile=authority)
        if certificate:
            context.load_cert_chain(certificate, key, no_password)
    except OSError as error:
        named = ", ".join(file for file in files if file)
        why = "give a key without a password" if asked else error.strerror or error
        raise ValueError(f"{named}: can't be used for TLS: {why}") from error
    return context


def _files(environment: Mapping[str, str]) -> List[Optional[str]]:
    """The authority, the certificate and its key; None for one that is not named."""
    names = ("CA", "CLIENT_CERT", "CLIENT_KEY")
    return [environment.get(f"ORACLE_{name}") or None for name in names]
