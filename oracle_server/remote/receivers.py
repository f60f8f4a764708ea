"""Who is told of alarms: the file that `ORACLE_ALARMS` names."""

from __future__ import annotations

import base64
import binascii
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args
from urllib.parse import urlsplit

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StrictStr, ValidationError

from oracle_server.core.errors import Finding, SpecError
from oracle_server.process.settings import SettingsError
from oracle_server.specfiles.document import Document, read_yaml

What = Literal["violation", "final", "degraded", "session_ended"]
_LONGEST = 2**16
_SHORTEST_SECRET = 16
_ENCODED = "whsec_"
"""What secrets begin with that are written in base64, as Standard Webhooks have them."""


def _reachable(url: str) -> str:
    """An address with a host and, if any, a port that there can be. Raises ValueError for any other."""
    parts = urlsplit(url)
    (parts.hostname or "").encode("idna")  # as of `a..b` there is no alarm that could be sent
    if not parts.hostname or parts.port == 0:  # a port beyond all others raises by itself
        raise ValueError
    return url


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Secret(_Model):
    env: StrictStr | None = None
    file: StrictStr | None = None


class _Receiver(_Model):
    url: Annotated[StrictStr, Field(pattern=r"^https?://[^/@\s]+(/\S*)?$"), AfterValidator(_reachable)]
    what: Annotated[list[What], Field(min_length=1)] = ["violation"]
    secret: _Secret


class _Alarms(_Model):
    alarms: Annotated[list[_Receiver], Field(min_length=1, max_length=10)]


class Receiver(NamedTuple):
    """An address that alarms are sent to: which ones, and the secret that they are signed with."""

    url: str
    what: frozenset[What]
    secret: bytes

    @property
    def host(self) -> str:
        """The address up to its path: what is behind it is often a secret itself."""
        parts = urlsplit(self.url)
        return f"{parts.scheme}://{parts.netloc}"


def load_receivers(path: Path, environment: Mapping[str, str] = os.environ) -> list[Receiver]:
    """The receivers of a file. Raises `SettingsError` with every mistake, and where."""
    try:
        with path.open("rb") as file:
            data = file.read(_LONGEST + 1)
        if len(data) > _LONGEST:
            raise SettingsError(f"ORACLE_ALARMS: {path}: has more than {_LONGEST} bytes; leave some out")
        document = read_yaml(data.decode(), str(path))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise SettingsError(f"ORACLE_ALARMS: {path}: can't be read: {reason}") from None
    except SpecError as error:
        raise SettingsError(f"ORACLE_ALARMS: {error}") from None
    try:
        model = _Alarms.model_validate(document.value)
    except ValidationError as error:
        raise _refused([_finding(document, problem) for problem in error.errors()]) from None
    found, wrong = [], []
    for i, receiver in enumerate(model.alarms):
        try:
            secret = _secret(receiver.secret, environment)
        except ValueError as error:
            wrong.append(Finding(str(path), *document.place(("alarms", i, "secret")), f"`secret`: {error}"))
        else:
            found.append(Receiver(receiver.url, frozenset(receiver.what), secret))
    if wrong:
        raise _refused(wrong)
    return found


_TAKES = {
    "alarms": "a list of one to ten receivers, each of which begins with `- url:`",
    "url": "an address such as https://ops.example/alarms, without a user in it",
    "what": f"a list of {', '.join(get_args(What))}",
    "secret": "{env: NAME} or {file: PATH}",
    "env": "the name of a variable of the environment",
    "file": "the path of a file",
}


def _finding(document: Document, problem: Any) -> Finding:
    path = tuple(problem["loc"])
    names = [part for part in path if isinstance(part, str)]
    key = names[-1] if names else "alarms"
    if problem["type"] == "extra_forbidden":
        level = {1: "the file has `alarms`", 3: "a receiver has `url`, `what` and `secret`"}
        message = f"unknown key '{key}'; {level.get(len(path), '`secret` has `env` or `file`')}"
        return Finding(document.file, *document.key_place(path), message)
    place = document.place(path[:-1] if problem["type"] == "missing" else path)
    missing = "is missing: write" if problem["type"] == "missing" else "must be"
    return Finding(document.file, *place, f"`{key}` {missing} {_TAKES[key]}")


def _secret(given: _Secret, environment: Mapping[str, str]) -> bytes:
    """The bytes of a secret. Raises ValueError where there is none, or one that is easily guessed or read by others."""
    if (given.env is None) == (given.file is None):
        raise ValueError("write either {env: NAME} or {file: PATH}")
    if given.env is not None:
        text, where = environment.get(given.env, ""), f"the variable {given.env}"
    else:
        where = f"the file {given.file}"
        try:
            if Path(given.file or "").stat().st_mode & 0o077:
                raise ValueError(f"{where} can be read by others: chmod 600 {given.file}")
            text = Path(given.file or "").read_text(encoding="utf-8")
        except OSError as error:
            raise ValueError(f"{where} can't be read: {error.strerror}") from None
    secret = text.strip()
    try:
        made = base64.b64decode(secret.removeprefix(_ENCODED), validate=True)
    except binascii.Error:
        made = b""
    made = made if secret.startswith(_ENCODED) else secret.encode()
    if len(made) < _SHORTEST_SECRET:
        raise ValueError(f"{where} must have {_SHORTEST_SECRET} bytes at least, as `openssl rand -hex 32` prints them")
    return made


def _refused(findings: list[Finding]) -> SettingsError:
    return SettingsError(f"ORACLE_ALARMS: {SpecError(findings)}")
