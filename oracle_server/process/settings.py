"""What a server can be told: on the command line, or by environment variables that start with ORACLE_."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, ValidationError, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from oracle_server.core.errors import OracleError
from oracle_server.core.units import duration, size

TOKEN_FILE = "tokens.json"  # noqa: S105 -- the name of a file


def _data_dir() -> Path:
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(state) / "oracle-server"


class Settings(BaseSettings):
    """A server's settings; durations in seconds."""

    model_config = SettingsConfigDict(env_prefix="ORACLE_", extra="ignore", frozen=True)

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8642
    data_dir: Path = Field(default_factory=_data_dir)
    specs: Path | None = None
    legacy: str | None = None
    history: Literal["sqlite", "memory"] = "sqlite"
    """Where the history is kept: in the data directory, or in memory, where it ends with the process."""
    durability: Literal["full", "normal"] = "full"
    resume_within: Annotated[float, Field(gt=0, le=3600)] = 10.0
    log: Literal["console", "json"] = "console"
    log_file: Path | None = None
    """Where the log goes instead of standard error, with rotation."""
    tokens: Path | None = None
    """The file of the tokens' hashes; default `tokens.json` in the data directory."""
    tls_cert: Path | None = None
    tls_key: Path | None = None
    tls_client_ca: Path | None = None
    """Clients must show a certificate that this authority signed."""
    insecure: bool = False
    """Whether a bind beyond loopback may go without tokens or TLS."""
    allowed_hosts: str = ""
    """Names, separated by commas, that the server may be called by besides its addresses and those of loopback."""
    retain_age: Annotated[int, BeforeValidator(duration)] | None = None
    """How long a closed session's history is kept, such as `720h`; in nanoseconds once it is read."""
    retain_events: Annotated[int, Field(ge=1)] | None = None
    """Events of which the history is kept; closed sessions make room, the oldest first."""
    retain_size: Annotated[int, BeforeValidator(size)] | None = None
    """How large the history may grow, such as `2GB`; in bytes once it is read."""
    retain_check: Annotated[float, Field(gt=0)] = 60.0
    """Seconds between two looks at what need not be kept any longer."""
    max_connections: Annotated[int, Field(ge=1, le=100_000)] = 2_000
    max_rate: Annotated[float, Field(ge=0)] = 20_000.0
    """Events a second that one monitor may send on average; 0 for any number."""

    @property
    def token_file(self) -> Path:
        """Where the tokens' hashes are."""
        return self.tokens or self.data_dir / TOKEN_FILE

    @model_validator(mode="after")
    def _certificates_are_whole(self) -> Self:
        if (self.tls_cert is None) != (self.tls_key is None) or (self.tls_client_ca and not self.tls_cert):
            raise ValueError("TLS needs both ORACLE_TLS_CERT and ORACLE_TLS_KEY")
        return self


class SettingsError(OracleError):
    """A setting that can't be used."""


def load_settings(**given: Any) -> Settings:
    """The settings: those given that are not None, else the environment's. Raises `SettingsError`."""
    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        if not first["loc"]:
            raise SettingsError(first["msg"].removeprefix("Value error, ")) from None
        name = str(first["loc"][0])
        raise SettingsError(f"ORACLE_{name.upper()} or --{name.replace('_', '-')}: {first['msg']}") from None
