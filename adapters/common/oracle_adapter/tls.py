"""TLS for a link that is given none: as the environment says, so that adapters need no options."""

from __future__ import annotations

import ssl
from typing import Mapping


def context_from(environment: Mapping[str, str]) -> ssl.SSLContext:
    """By `ORACLE_CA`, or the system's authorities; with `ORACLE_CLIENT_CERT`, `ORACLE_CLIENT_KEY`.

    Raises `ValueError` where a file can't be used.
    """
    files = [
        environment.get(f"ORACLE_{name}") or None for name in ("CA", "CLIENT_CERT", "CLIENT_KEY")
    ]
    authority, certificate, key = files
    try:
        context = ssl.create_default_context(cafile=authority)
        if certificate:
            context.load_cert_chain(certificate, key)
    except OSError as error:
        named = ", ".join(file for file in files if file)
        raise ValueError(f"{named}: can't be used for TLS: {error.strerror or error}") from error
    return context
