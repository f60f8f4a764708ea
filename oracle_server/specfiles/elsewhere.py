"""Properties that an oracle elsewhere judges: what is wrong with their keys."""

from __future__ import annotations

import re
from collections.abc import Iterator
from urllib.parse import urlsplit

from oracle_server.specfiles.model import PropertyModel
from oracle_server.specfiles.sentences import SAYS


def external_problems(model: PropertyModel) -> Iterator[tuple[str, str]]:
    """The problems of a property that an external oracle judges: the key, and why."""
    if model.url is None:
        yield "engine", "`engine: external` needs the oracle's address, `url: ws://host:port`"
    else:
        reason = _unusable(model.url)
        if reason:
            yield "url", f"the address {model.url} {reason}"
    for key in SAYS:
        if getattr(model, key) is not None:
            yield key, f"the oracle at `url` has a property of its own; leave `{key}` out"
    if model.time != "steps":
        yield "time", "the oracle at `url` has a time of its own; leave `time` out"


def _unusable(url: str) -> str | None:
    """Why a URL can't be the address of an oracle, None where it can."""
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        return f"can't be read: {error}"
    if not parts.hostname or re.search(r"[\s\x00-\x1f]", url):
        return "names no host"
    if parts.hostname in ("ws", "wss", "http", "https") and parts.path.startswith("//"):
        return "has two schemes; write it as `ws://host:port`"
    if port == 0:
        return "has port 0, which nothing listens on"
    if parts.username is not None or parts.password is not None:
        return "contains a name or password; specs can be read by everyone who may read verdicts"
    return "has a fragment after #, which is not sent to a server" if parts.fragment else None
