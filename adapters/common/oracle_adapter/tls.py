"""TLS for a link that is given none: by environment variables, so that adapters need no options."""

from __future__ import annotations

import ssl
from typing import Mapping


def context_from(environment: Mapping[str, str]) -> ssl.SSLContext:
    """By `ORACLE_CA`, or the system's authorities; with `ORACLE_CLIENT_CERT`, `ORACLE_CLIENT_KEY`.

    Raises `ValueError` where a file can't be used, such as a key with a password.
    """
    asked = False

    def no_password() -> str:  # without it OpenSSL asks on the terminal, and waits for an answer
        nonlocal asked
        asked = True
        return ""

    files = [
        environment.get(f"ORACLE_{name}") or None for name in ("CA", "CLIENT_CERT", "CLIENT_KEY")
    ]
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
