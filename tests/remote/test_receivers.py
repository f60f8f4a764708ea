"""The file of who is told of alarms: read, and refused with every mistake and its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from oracle_server.process.settings import SettingsError
from oracle_server.remote.receivers import load_receivers

SECRET = "0123456789abcdef"
SOUND = "alarms:\n  - url: https://ops.example/a\n    secret: {env: HOOK}\n"


def read(folder: Path, text: str, **environment: str) -> list[tuple[str, set[str], bytes]]:
    path = folder / "alarms.yaml"
    path.write_text(text)
    return [(r.url, set(r.what), r.secret) for r in load_receivers(path, {"HOOK": SECRET, **environment})]


def test_receivers_are_read_with_their_secrets(tmp_path: Path) -> None:
    assert read(tmp_path, SOUND) == [("https://ops.example/a", {"violation"}, SECRET.encode())]
    kept = tmp_path / "secret"
    kept.write_text(f"{SECRET}\n")
    kept.chmod(0o600)
    more = f"  - url: http://10.0.0.1:8080\n    what: [final, session_ended]\n    secret: {{file: {kept}}}\n"
    found = read(tmp_path, SOUND + more, HOOK="whsec_" + "QUJD" * 8)
    assert found[0][2] == b"ABC" * 8
    assert found[1] == ("http://10.0.0.1:8080", {"final", "session_ended"}, SECRET.encode())


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "`alarms` must be a list"),
        ("alarms: []\n", ":1:9: `alarms` must be a list of one to ten receivers"),
        ("alarm: 3\n", ":1:1: unknown key 'alarm'; the file has `alarms`"),
        (SOUND.replace("https://", "ftp://"), ":2:10: `url` must be an address such as https://"),
        (SOUND.replace("https://", "https://user:word@"), "without a user in it"),
        (SOUND.replace("ops.example", "ops.example:84430"), ":2:10: `url` must be an address such as https://"),
        (SOUND.replace("ops.example", "ops.example:alarms"), ":2:10: `url` must be an address such as https://"),
        (SOUND.replace("ops.example", "ops..example"), ":2:10: `url` must be an address such as https://"),
        (SOUND.replace("ops.example", "[fd00::1"), ":2:10: `url` must be an address such as https://"),
        (SOUND.replace("url", "uri"), ":2:5: unknown key 'uri'; a receiver has `url`, `what` and `secret`"),
        (
            f"{SOUND}    what: [violations]\n",
            ":4:12: `what` must be a list of violation, final, degraded, session_ended",
        ),
        (
            SOUND.replace("    secret: {env: HOOK}\n", ""),
            ":2:5: `secret` is missing: write {env: NAME} or {file: PATH}",
        ),
        (SOUND.replace("HOOK", "NONE"), ":3:13: `secret`: the variable NONE must have 16 bytes at least"),
        (SOUND.replace("env: HOOK", ""), ":3:13: `secret`: write either {env: NAME} or {file: PATH}"),
        (SOUND.replace("env: HOOK", "file: /nowhere"), "the file /nowhere can't be read: No such file"),
        ("alarms: [\n", "alarms.yaml:"),
    ],
)
def test_mistakes_are_told_with_their_place(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(SettingsError) as refused:
        read(tmp_path, text)
    assert str(refused.value).startswith("ORACLE_ALARMS: ")
    assert reason in str(refused.value)


def test_a_file_without_an_end_is_refused() -> None:
    with pytest.raises(SettingsError, match="/dev/zero: has more than 65536 bytes"):
        load_receivers(Path("/dev/zero"))


def test_a_secret_that_others_can_read_is_refused(tmp_path: Path) -> None:
    kept = tmp_path / "secret"
    kept.write_text(SECRET)
    kept.chmod(0o644)
    with pytest.raises(SettingsError, match="chmod 600"):
        read(tmp_path, SOUND.replace("env: HOOK", f"file: {kept}"))
    with pytest.raises(SettingsError, match=r"can't be read: No such file"):
        load_receivers(tmp_path / "nowhere.yaml", {})
