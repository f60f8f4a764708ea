"""The server's settings, from the command line or from environment variables that start with ORACLE_."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal, Self
from urllib.parse import urlsplit

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from oracle_server.core.errors import OracleError
from oracle_server.core.nearest import near
from oracle_server.core.units import duration, kept, size

TOKEN_FILE = "tokens.json"  # noqa: S105 -- the name of a file
_PREFIX = "ORACLE_"
_OF_CLIENTS = frozenset({"url", "token", "ca", "client_cert", "client_key"})
"""What is read from the environment by what reaches a server."""

POSTGRES = ("postgresql://", "postgres://")
"""How the URL of a history in PostgreSQL begins."""
LONGEST_LEASE = 60.0
"""Seconds."""


def _data_dir() -> Path:
    state = os.environ.get("XDG_STATE_HOME")
    if state:
        return Path(state) / "oracle-server"
    try:
        return Path.home() / ".local" / "state" / "oracle-server"
    except RuntimeError:  # as for a container's user that is a number alone
        raise SettingsError(
            "there is no data directory: this user has no home directory, by HOME or the list of users; name one by "
            "--data-dir or ORACLE_DATA_DIR"
        ) from None


def _bound(value: str) -> str:
    host = value.strip()
    if host.startswith("[") and host.endswith("]"):  # as URLs have it
        host = host[1:-1]
    if not host or host.count(":") == 1 or set(host) & set("/[]"):
        raise ValueError(f"'{value}': write a name or an address alone, as 127.0.0.1 or ::1; the port is ORACLE_PORT")
    return host


def _named(value: object) -> object:
    if isinstance(value, str) and not value.strip():  # it would be the working directory
        raise ValueError("it is empty: leave it out, or name a file or folder")
    return value


Named = Annotated[Path, BeforeValidator(_named)]
"""A path of a file or folder."""


def _history(value: str) -> str:
    if value not in ("sqlite", "memory") and not value.startswith(POSTGRES):
        raise ValueError("write sqlite, memory, or postgresql://USER@HOST/DATABASE")
    return value


def _forward(value: str) -> str:
    if not value.startswith(POSTGRES):
        raise ValueError("write postgresql://USER@HOST/DATABASE, the centre's history")
    return value


def _reached(value: str) -> str:
    parts = urlsplit(value)
    if parts.scheme not in ("http", "https", "ws", "wss") or not parts.hostname:
        raise ValueError("write a URL that monitors reach this server by, such as https://oracle1.example.org:8642")
    return value.rstrip("/")


class Settings(BaseSettings):
    """A server's settings; durations in seconds."""

    model_config = SettingsConfigDict(env_prefix=_PREFIX, extra="ignore", frozen=True)

    host: Annotated[str, AfterValidator(_bound)] = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8642
    data_dir: Named = Field(default_factory=_data_dir)
    specs: Named | None = None
    types: str = ""
    """Folders with definitions of ROS types, by which specs are checked; several are separated as in PATH."""
    legacy: str | None = None
    legacy_finals: bool = False
    """Whether ROSMonitoring's monitors are told `true` and `false`, at which those that only log end."""
    history: Annotated[str, AfterValidator(_history)] = Field("sqlite", repr=False)
    """Where the history is kept: `sqlite`, in the data directory; `memory`, where it ends with the process; a URL."""
    lease: Annotated[float, Field(ge=0.5, le=LONGEST_LEASE)] = 3.0
    """Seconds for which a server has its sessions in PostgreSQL without an answer from there."""
    node: Annotated[str, Field(pattern=r"^[A-Za-z0-9._:-]{1,100}$")] | None = None
    """The server's name among those that share a history; default its host's name and its port."""
    advertise: Annotated[str, AfterValidator(_reached)] | None = None
    """The server's URL, as monitors are told it by other servers."""
    forward: Annotated[str, AfterValidator(_forward)] | None = Field(None, repr=False)
    """The URL of the centre's history, to which the one in the data directory is forwarded."""
    origin: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")] | None = None
    """The robot's name there; default its host's name."""
    forward_hold: Annotated[int, BeforeValidator(size)] = Field("4GB", validate_default=True)
    """The size of the history up to which nothing is deleted that is not forwarded yet; parsed to bytes."""
    durability: Literal["full", "normal"] = "full"
    resume_within: Annotated[float, Field(gt=0, le=3600)] = 10.0
    log: Literal["console", "json"] = "console"
    log_file: Named | None = None
    """Where the log goes instead of standard error, with rotation."""
    tokens: Named | None = None
    """The file of the tokens' hashes; default `tokens.json` in the data directory."""
    tls_cert: Named | None = None
    tls_key: Named | None = None
    tls_client_ca: Named | None = None
    """Clients must present a certificate that this authority signed."""
    read_only: bool = False
    """Whether to only read a history that another process of this machine writes, or wrote."""
    unix: Named | None = None
    """A UNIX socket at which the server listens too."""
    insecure: bool = False
    """Whether to allow a bind beyond loopback without tokens or TLS."""
    allowed_hosts: str = ""
    """Host names of the server, separated by commas, besides its address and the names of loopback."""
    retain_age: Annotated[int, BeforeValidator(duration), AfterValidator(kept)] | None = None
    """How long history is kept, such as `720h`; parsed to nanoseconds."""
    retain_events: Annotated[int, Field(ge=1)] | None = None
    """The most events in the history; those of closed sessions are deleted first, the oldest before others."""
    retain_size: Annotated[int, BeforeValidator(size), AfterValidator(kept)] | None = None
    """The greatest size of the history, such as `2GB`; parsed to bytes."""
    retain_check: Annotated[float, Field(gt=0)] = 60.0
    """Seconds between two runs of the deletion of old history."""
    foxglove: Annotated[int, Field(ge=0, le=65535)] | None = None
    """The port at which sessions are offered to Foxglove as they go on, on the server's host."""
    foxglove_insecure: bool = False
    """Whether to offer them beyond loopback where clients of the server itself need a token or a certificate."""
    alarms: Named | None = None
    """A file that says who is told of violations."""
    max_recording: Annotated[int, BeforeValidator(size)] = Field("1GB", validate_default=True)
    """The size of a recording that clients may send to be judged, such as `500MB`; parsed to bytes."""
    max_connections: Annotated[int, Field(ge=1, le=100_000)] = 2_000
    max_rate: Annotated[float, Field(ge=0)] = 20_000.0
    """Events a second that one monitor may send on average; 0 is no limit."""

    @property
    def type_folders(self) -> list[Path]:
        """The folders of `types`."""
        return [Path(folder) for folder in self.types.split(os.pathsep) if folder]

    @property
    def token_file(self) -> Path:
        """The file of the tokens' hashes."""
        return self.tokens or self.data_dir / TOKEN_FILE

    @model_validator(mode="after")
    def _forwards_what_is_kept(self) -> Self:
        if self.forward is not None and (self.history != "sqlite" or self.durability != "full"):
            raise ValueError(
                "ORACLE_FORWARD forwards the history of the data directory: leave ORACLE_HISTORY out, and have "
                "ORACLE_DURABILITY=full, so that the centre has nothing that a power cut took from here"
            )
        return self

    @model_validator(mode="after")
    def _only_reads(self) -> Self:
        if not self.read_only:
            return self
        if self.history != "sqlite":
            raise ValueError("ORACLE_READ_ONLY or --read-only reads a history in SQLite: leave ORACLE_HISTORY out")
        writing = ("forward", "foxglove", "alarms", "legacy")
        given = [f"ORACLE_{name.upper()}" for name in writing if getattr(self, name) is not None]
        if given:
            raise ValueError(f"a server that only reads has no sessions of its own: leave {', '.join(given)} out")
        return self

    @model_validator(mode="after")
    def _certificates_are_whole(self) -> Self:
        if (self.tls_cert is None) != (self.tls_key is None) or (self.tls_client_ca and not self.tls_cert):
            raise ValueError("TLS needs both ORACLE_TLS_CERT and ORACLE_TLS_KEY")
        return self


class SettingsError(OracleError):
    """A setting that can't be used."""


_KUBERNETES = (
    "; Kubernetes sets it so for a Service that is called oracle: give that another name, or write "
    "enableServiceLinks: false in the pod's spec"
)


def load_settings(**given: Any) -> Settings:
    """The settings: those `given` that are not None, all others from the environment. Raises `SettingsError`."""
    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        why = first["msg"].removeprefix("Value error, ")
        if not first["loc"]:
            raise SettingsError(why) from None
        name = str(first["loc"][0])
        where = f"ORACLE_{name.upper()}" if given.get(name) is None else f"--{name.replace('_', '-')}"
        hint = _KUBERNETES if where == "ORACLE_PORT" and str(first["input"]).startswith("tcp://") else ""
        raise SettingsError(f"{where}: {why}{hint}") from None


def unknown_variables() -> list[str]:
    """The environment variables that are called as settings are, and are none, each with what may have been meant."""
    known = sorted(_OF_CLIENTS.union(Settings.model_fields))
    found = []
    for name in sorted(os.environ):
        own = name[len(_PREFIX) :].lower()
        if name.upper().startswith(_PREFIX) and own not in known:
            meant = [f"(did you mean {_PREFIX}{other.upper()}?)" for other in near(own, known)[:1]]
            found.append(" ".join((name, *meant)))
    return found
