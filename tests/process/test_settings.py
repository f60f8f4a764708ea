"""Settings that can't be found out."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from oracle_server.process.settings import SettingsError, load_settings, unknown_variables


@pytest.fixture
def homeless(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A user without HOME and an entry in the list of users, as a container's may be."""

    def unknown(*_: object) -> None:
        raise KeyError("getpwuid(): uid not found")

    for name in ("HOME", "XDG_STATE_HOME", "ORACLE_DATA_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", unknown)
    return monkeypatch


def test_a_user_without_a_home_is_told_to_name_a_data_directory(homeless: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"has no home directory.* --data-dir or ORACLE_DATA_DIR"):
        load_settings()
    assert load_settings(data_dir=tmp_path).data_dir == tmp_path
    homeless.setenv("ORACLE_DATA_DIR", str(tmp_path))
    assert load_settings().data_dir == tmp_path
    homeless.delenv("ORACLE_DATA_DIR")
    homeless.setenv("XDG_STATE_HOME", str(tmp_path))
    assert load_settings().data_dir == tmp_path / "oracle-server"


def test_what_is_wrong_is_told_by_the_name_it_was_given_by(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ORACLE_RETAIN_SIZE", "lots")
    with pytest.raises(SettingsError, match=r"^ORACLE_RETAIN_SIZE: expected a size such as 500MB.*'lots'$"):
        load_settings(data_dir=tmp_path)
    monkeypatch.delenv("ORACLE_RETAIN_SIZE")
    with pytest.raises(SettingsError, match=r"^--forward: write postgresql://"):
        load_settings(data_dir=tmp_path, forward="mysql://centre")


def test_an_empty_path_is_not_the_working_directory(monkeypatch: pytest.MonkeyPatch) -> None:
    """As `ORACLE_DATA_DIR=` of a file of settings has it: the history was written wherever the server was started."""
    for name in ("DATA_DIR", "SPECS", "LOG_FILE", "TOKENS", "TLS_CERT", "TLS_CLIENT_CA", "UNIX", "ALARMS"):
        with monkeypatch.context() as context:
            context.setenv(f"ORACLE_{name}", " ")
            with pytest.raises(SettingsError, match=rf"^ORACLE_{name}: it is empty: leave it out"):
                load_settings()


def test_a_bound_on_the_history_is_not_0(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of other limits it means none, as of `ORACLE_MAX_RATE`: here all was deleted at once, violations too."""
    for name, value in (("AGE", "0s"), ("SIZE", "0MB"), ("EVENTS", "0")):
        with monkeypatch.context() as context:
            context.setenv(f"ORACLE_RETAIN_{name}", value)
            with pytest.raises(SettingsError, match=rf"^ORACLE_RETAIN_{name}: "):
                load_settings()


def test_a_host_is_a_name_or_an_address_alone() -> None:
    """Of `[::1]` it was said that others could reach the server there, and that tokens and TLS were missing."""
    assert [load_settings(host=host).host for host in ("[::1]", "::", "localhost ")] == ["::1", "::", "localhost"]
    for host in ("http://0.0.0.0", "127.0.0.1:8642", "[::1]:8642", ""):
        with pytest.raises(
            SettingsError, match=r"^--host: .* write a name or an address alone, as 127\.0\.0\.1 or ::1"
        ):
            load_settings(host=host)


def test_what_kubernetes_puts_in_a_settings_place_is_told_as_its_doing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ORACLE_PORT", "tcp://10.0.0.1:8642")
    with pytest.raises(SettingsError, match=r"^ORACLE_PORT: .*Kubernetes .* a Service that is called oracle"):
        load_settings()


def test_a_variable_that_names_no_setting_is_told_with_what_may_have_been_meant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A misspelt limit was no limit, and nobody said so."""
    for name in [name for name in os.environ if name.upper().startswith("ORACLE_")]:
        monkeypatch.delenv(name)
    for name in ("ORACLE_PORT", "oracle_host", "ORACLE_TOKEN", "ORACLE_CLIENT_KEY", "ORACLES", "MY_ORACLE_PROT"):
        monkeypatch.setenv(name, "1")
    assert unknown_variables() == []
    for name in ("ORACLE_RETAIN_SISE", "ORACLE_HOME", "oracle_prot"):
        monkeypatch.setenv(name, "1")
    assert unknown_variables() == [
        "ORACLE_HOME",
        "ORACLE_RETAIN_SISE (did you mean ORACLE_RETAIN_SIZE?)",
        "oracle_prot (did you mean ORACLE_PORT?)",
    ]
