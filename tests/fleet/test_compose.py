"""What `packaging/compose.fleet.yaml` starts fits together; its standby is made by the scripts that it has."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

import pytest

from oracle_server.core.errors import HistoryError
from oracle_server.history.postgres.connection import Connection
from tests.fleet.demo import ROBOT
from tests.postgres import Postgres, needed
from tests.processes import eventually
from tests.test_containers import FLEET, FOLDER
from tests.whole.harness import Server

SERVICES = FLEET["services"]
SERVERS = {name: service for name, service in SERVICES.items() if service["image"] == "oracle-server"}
ROBOTS = {name: service for name, service in SERVICES.items() if service["image"] == "oracle-ros2"}


def test_robots_know_the_servers_as_these_are_told_of() -> None:
    assert len(SERVERS) == 3
    assert len(ROBOTS) == 2
    advertised = set()
    for name, service in SERVERS.items():
        settings = service["environment"]
        assert settings["ORACLE_NODE"] == name
        assert name in settings["ORACLE_ALLOWED_HOSTS"].split(",")
        advertised.add(settings["ORACLE_ADVERTISE"])
        assert service["depends_on"] == {"standby": {"condition": "service_healthy"}}
        assert f"{name}:/data" in service["volumes"]
    for robot, service in ROBOTS.items():
        program, path, *words = service["command"]
        options = dict(zip(words[::2], words[1::2], strict=True))
        assert (program, options["--session"]) == ("python3", robot)
        assert set(options["--oracle"].split(",")) == advertised
        ((source, target, _),) = (volume.split(":") for volume in service["volumes"])
        assert (FOLDER / source / Path(path).relative_to(target)).resolve() == ROBOT
        assert f"{source}:/specs:ro" in SERVERS["a"]["volumes"]
        assert service["depends_on"].keys() == SERVERS.keys()


def test_what_is_acked_is_with_the_standby_that_the_scripts_make(tmp_path: Path) -> None:
    needed()
    (setting,) = SERVICES["database"]["command"][2:]
    name, value = setting.split("=")
    with Postgres({name: value}) as primary:
        assert primary.script(FOLDER / "fleet" / "primary.sh").wait() == 0
        with standby(primary) as url:
            specs = ROBOT.parent
            settings = SERVERS["a"]["environment"] | {"ORACLE_HISTORY": primary.url()}
            told = {key: value for key, value in settings.items() if key not in ("ORACLE_DATA_DIR", "PGPASSWORD")}
            with Server(specs, tmp_path, **told) as server:
                assert "the history is committed on a standby too" in server.log
                made = server.http.post("/api/v1/sessions", json={"spec": "forklift", "id": "s"})
                assert made.status_code == 201
                (kept,) = eventually(lambda: primary.do("SELECT id FROM sessions", url), len)
                assert kept == ("s",)


def test_a_standby_is_not_taken_for_the_database_where_a_url_has_both() -> None:
    """What was read there could lack what was committed; a server that took sessions over would judge that again."""
    needed()
    name, value = SERVICES["database"]["command"][2].split("=")
    with Postgres({name: value}) as primary:
        assert primary.script(FOLDER / "fleet" / "primary.sh").wait() == 0
        with standby(primary) as url:
            both = url.replace("port=5433", "port=5433,5432").replace(
                "host=", f"host={quote(str(primary.folder), safe='')},"
            )
            with contextlib.closing(Connection(both, "test", 10.0)) as connection:
                assert connection.execute("SELECT pg_is_in_recovery()").fetchone() == (False,)
            primary.stop()
            with pytest.raises(HistoryError, match="server is in hot standby mode"):
                Connection(both, "test", 10.0)
            primary.start()


@contextlib.contextmanager
def standby(primary: Postgres) -> Iterator[str]:
    """A standby of a database, made by its script; how it is reached."""
    folder = primary.folder / "standby"
    options = ["-c", f"unix_socket_directories={primary.folder}", "-c", "port=5433"]
    process = primary.script(FOLDER / "fleet" / "standby.sh", folder, *options)
    url = f"postgresql://tests@/postgres?host={quote(str(primary.folder), safe='')}&port=5433"
    try:
        following = "SELECT 1 FROM pg_stat_replication WHERE sync_state = 'sync'"
        eventually(lambda: primary.do(following), len)
        yield url
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()
