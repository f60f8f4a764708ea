"""Tokens and what they grant. A file holds their hashes, and never a token itself."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import os
import secrets
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import structlog
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from oracle_server.core.errors import OracleError
from oracle_server.history.origins import origin_of, own_name
from oracle_server.sessions.runs import goes_on
from oracle_server.wire.incoming import Identifier, SessionName, why

Scope = Literal["submit", "read", "admin"]
_PREFIX = "oracle_"

log = structlog.get_logger()


class TokenError(OracleError):
    """A token file that can't be used, or a token that can't be added or removed."""


class Token(BaseModel):
    """One token as the file has it; without `specs` or `sessions` it is valid for all of them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Identifier
    sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    scopes: Annotated[frozenset[Scope], Field(min_length=1)]
    specs: frozenset[Identifier] | None = None
    sessions: frozenset[SessionName] | None = None


class _File(BaseModel):
    """A file as it is written; its tokens are looked at one by one, since others have the interpreter between them."""

    model_config = ConfigDict(extra="forbid")

    tokens: list[dict[str, Any]] = []


@dataclass(frozen=True, slots=True)
class Grant:
    """What the sender of a request may do. `admin` includes `read` and `submit`."""

    scopes: frozenset[Scope]
    specs: frozenset[str] | None = None
    sessions: frozenset[str] | None = None

    def may(self, scope: Scope) -> bool:
        """Whether the grant has a scope."""
        return scope in self.scopes or "admin" in self.scopes

    def covers(self, *, spec: str | None = None, session: str | None = None) -> bool:
        """Whether the grant is valid for a spec and a session; a grant that is bound to some never covers None."""
        return (self.specs is None or spec in self.specs) and self.covers_session(session)

    @property
    def bound(self) -> bool:
        """Whether the grant is valid for some specs or sessions only."""
        return self.specs is not None or self.sessions is not None

    def covers_session(self, session: str | None) -> bool:
        """Whether the grant is valid for a session: one that it names, or one in which the server has that go on."""
        if self.sessions is None:
            return True
        return session is not None and any(_is_of(session, named) for named in self.sessions)


def _is_of(session: str, named: str) -> bool:
    """Whether a session is the one of a name, or goes on with it; a robot's, where it is forwarded from there."""
    own, known = own_name(session), own_name(named)
    return origin_of(session) == origin_of(named) and (own == known or goes_on(own, known))


EVERYTHING = Grant(frozenset({"admin"}))


class Tokens:
    """The tokens of a file, which is read again whenever it has changed.

    Once there was a file, a token is needed until the server ends: with a file that is lost or damaged, every request
    is refused. It is read in a thread, and requests wait for that: ten thousand take a tenth of a second.
    """

    def __init__(self, path: Path) -> None:
        """Read the file if it exists. Raises `TokenError` where it can't be used."""
        self._path = path
        self._seen: tuple[int, ...] | None = None
        self._grants: dict[str, Grant] = {}
        self._changed = True
        self.unreadable = False
        """Whether the file that is there now can't be used: nobody is known then, with a good token either."""
        self._reading = asyncio.Lock()
        self.required = _is_there(path)
        if self.required:
            self._seen = _stat(path)  # before reading: a change meanwhile is noticed the next time
            self._grants = _grants(path)

    async def grant(self, token: str | None) -> Grant | None:
        """The grant of a token, None for an unknown one."""
        await self._refresh()
        return self.known(hash_of(token or ""))  # how long that takes tells of the hash, and nothing of a token

    async def refreshed(self) -> bool:
        """Read the file again if it has changed; whether it was read since the last call."""
        await self._refresh()
        changed, self._changed = self._changed, False
        return changed

    def known(self, offered: str) -> Grant | None:
        """The grant of a token by its hash, as of when the file was last read; None for an unknown one."""
        return self._grants.get(offered) if self.required else EVERYTHING

    async def _refresh(self) -> None:
        if _stat(self._path) == self._seen:
            return
        async with self._reading:
            seen = _stat(self._path)
            if seen == self._seen:
                return
            grants, unreadable = dict[str, Grant](), False
            try:
                grants = await asyncio.to_thread(_grants, self._path)
            except TokenError as error:
                unreadable = True
                log.error("the tokens can't be read: all requests are refused", reason=str(error))
            self.unreadable = unreadable
            self._seen, self._grants, self._changed, self.required = seen, grants, True, True


def _grants(path: Path) -> dict[str, Grant]:
    """What the tokens of a file grant, by their hashes. Raises `TokenError`."""
    return {token.sha256: Grant(token.scopes, token.specs, token.sessions) for token in _read(path)}


def add(
    path: Path,
    name: str,
    scopes: Iterable[str],
    specs: Iterable[str] | None = None,
    sessions: Iterable[str] | None = None,
) -> str:
    """Create a token, store its hash in the file, and return the token itself. Raises `TokenError`."""
    secret = _PREFIX + secrets.token_urlsafe(32)
    wanted = {"name": name, "sha256": hash_of(secret), "scopes": list(scopes), "specs": specs and list(specs)}
    try:
        token = Token.model_validate(wanted | {"sessions": sessions and list(sessions)})
    except ValidationError as error:
        first = error.errors()[0]
        raise TokenError(f"{first['loc'][0]}: {why(first)}") from None
    with _locked(path):
        tokens = listed(path)
        if any(known.name == name for known in tokens):
            raise TokenError(f"{path}: there is a token '{name}' already; remove it first")
        _write(path, [*tokens, token])
    return secret


def remove(path: Path, name: str) -> None:
    """Revoke a token by its name. Raises `TokenError`."""
    if all(known.name != name for known in listed(path)):
        raise TokenError(f"{path}: there is no token '{name}'")
    with _locked(path):
        _write(path, [known for known in listed(path) if known.name != name])


def listed(path: Path) -> list[Token]:
    """The tokens of a file, none where there is no file. Raises `TokenError`."""
    return _read(path) if _is_there(path) else []


def hash_of(token: str) -> str:
    """The hash of a token; a plain one is enough, since tokens have 256 random bits."""
    return hashlib.sha256(token.encode(errors="surrogateescape")).hexdigest()


def _is_there(path: Path) -> bool:
    """Whether there is a file: without one nobody needs a token. Raises `TokenError` where that can't be seen."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError as error:
        raise _unreadable(path, error) from None
    return True


def _unreadable(path: Path, error: OSError) -> TokenError:
    return TokenError(f"{path}: can't be read: {error.strerror}")


def _stat(path: Path) -> tuple[int, ...] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_ctime_ns, found.st_ino, found.st_size, found.st_mode


def _read(path: Path) -> list[Token]:
    found: list[Token] = []
    at = ""
    try:
        if not path.is_file():  # reading a pipe or a device would have no end, and all requests would wait
            raise TokenError(f"{path}: is no file; `oracle-server token add` makes one where there is none")
        if path.stat().st_mode & 0o077:
            raise TokenError(f"{path}: other users may read it; run `chmod 600 {path}`")
        for number, token in enumerate(_File.model_validate_json(path.read_bytes()).tokens):
            at = f"tokens.{number}."
            found.append(Token.model_validate(token))
    except OSError as error:
        raise _unreadable(path, error) from None
    except ValidationError as error:
        first = error.errors()[0]
        where = at + ".".join(str(part) for part in first["loc"])
        raise TokenError(f"{path}: {where + ': ' if where else ''}{why(first)}") from None
    return found


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Lock the file against changes by other processes, which would otherwise be overwritten."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        folder = os.open(path.parent, os.O_RDONLY)
    except OSError as error:
        raise TokenError(f"{path}: can't be written: {error.strerror}") from None
    import fcntl  # which Windows lacks, where a running server is read all the same

    try:
        fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def _write(path: Path, tokens: list[Token]) -> None:
    content = _File(tokens=[token.model_dump(mode="json", exclude_none=True) for token in tokens])
    text = content.model_dump_json(indent=2) + "\n"
    draft = path.with_name(path.name + ".draft")
    try:
        draft.unlink(missing_ok=True)
        with os.fdopen(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
            if os.geteuid() == 0:  # the server is another user, as systemd runs it, and has to read it
                owner = (path if path.exists() else path.parent).stat()
                os.fchown(file.fileno(), owner.st_uid, owner.st_gid)
            file.write(text)
        draft.replace(path)
    except OSError as error:
        raise TokenError(f"{path}: can't be written: {error.strerror}") from None
