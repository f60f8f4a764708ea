"""What a server can be told: on the command line, or by environment variables that start with ORACLE_."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict

from oracle_server.core.errors import OracleError


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
    durability: Literal["full", "normal"] = "full"
    resume_within: Annotated[float, Field(gt=0, le=3600)] = 10.0
    log: Literal["console", "json"] = "console"


class SettingsError(OracleError):
    """A setting that can't be used."""


def load_settings(**given: Any) -> Settings:
    """The settings: those given that are not None, else the environment's. Raises `SettingsError`."""
    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0])
        raise SettingsError(f"ORACLE_{name.upper()} or --{name.replace('_', '-')}: {first['msg']}") from None
