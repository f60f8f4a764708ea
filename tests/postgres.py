"""A PostgreSQL of the tests' own: made in a folder that nobody else uses, reached by a socket in it."""

from __future__ import annotations

import contextlib
import glob
import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Self
from urllib.parse import quote

import psycopg
import pytest

_PLACES = ("/usr/lib/postgresql/*/bin", "/usr/local/pgsql/bin", "/usr/local/bin", "/usr/bin")
_WITHIN = "120"
"""Seconds for it to start or stop."""
_ROOM = 2**31
"""Bytes that are enough for those of several workers."""


def programs() -> Path | None:
    """The folder of PostgreSQL's programs, of the newest version; None where it is not installed."""
    found = [Path(folder) for place in _PLACES for folder in sorted(glob.glob(place), reverse=True)]
    return next((folder for folder in found if (folder / "initdb").exists()), None)


def needed() -> Path:
    """The same; in CI a test fails where there is none, elsewhere it is skipped."""
    folder = programs()
    if folder is None:
        missing = "PostgreSQL is missing; install it (Debian: apt-get install postgresql)"
        if os.environ.get("CI"):
            pytest.fail(missing)
        pytest.skip(missing)
    return folder


class Postgres:
    """One server, which its user's own process may start, stop and kill. It refuses to be run by root."""

    def __init__(self, settings: Mapping[str, str] | None = None) -> None:
        """Make one, with settings of `postgresql.conf` besides those of the tests."""
        self._programs = needed()
        self._user = _unprivileged()
        # pytest's own folders are closed to other users
        self.folder = Path(tempfile.mkdtemp(prefix="oracle-postgres-", dir=_in_memory()))
        self._data = self.folder / "data"
        if self._user is not None:
            shutil.chown(self.folder, self._user)
        self._run("initdb", "-D", str(self._data), "-U", "tests", "-E", "UTF8", "--locale=C", "-A", "trust", "-N")
        own = {
            "listen_addresses": "''", "unix_socket_directories": f"'{self.folder}'", "max_connections": "60",
            "shared_buffers": "'16MB'", "log_min_messages": "fatal", "autovacuum": "off",
        } | dict(settings or {})  # fmt: skip
        with (self._data / "postgresql.conf").open("a") as file:
            file.writelines(f"{name} = {value}\n" for name, value in own.items())
        self.port = 5432
        self._made = 0

    def start(self) -> None:
        """Start it, and return once it answers."""
        log = str(self.folder / "log")
        self._run("pg_ctl", "start", "-w", "-s", "-t", _WITHIN, "-D", str(self._data), "-l", log)

    def stop(self, how: str = "fast") -> None:
        """Stop it: `fast`, or `immediate`, as a crash would."""
        self._run("pg_ctl", "stop", "-w", "-s", "-t", _WITHIN, "-m", how, "-D", str(self._data))

    def kill(self) -> None:
        """Kill it as a machine without memory would: its first process at once, by which all others end."""
        first = int((self._data / "postmaster.pid").read_text().split()[0])
        os.kill(first, signal.SIGSTOP)  # that it makes no others meanwhile
        others = [number for number in _processes() if _parent(number) == first]
        os.kill(first, signal.SIGKILL)
        while any(_parent(number) is not None for number in (first, *others)):
            time.sleep(0.01)
        # none of its processes is there any more; one that nobody waited for still looks to the next like one that runs
        (self._data / "postmaster.pid").unlink()
        (self.folder / f".s.PGSQL.{self.port}.lock").unlink()

    @contextlib.contextmanager
    def having(self, name: str, value: str) -> Iterator[None]:
        """Have another value for one of its settings within this."""
        ((before,),) = self.do(f"SHOW {name}")
        self.do(f"ALTER SYSTEM SET {name} = '{value}'")
        try:
            self._reload(name, value)
            yield
        finally:
            self.do(f"ALTER SYSTEM RESET {name}")
            self._reload(name, str(before))

    def url(self, schema: str | None = None, host: str | None = None, port: int | None = None) -> str:
        """How it is reached; in a schema of its own, if one is named."""
        options = "" if schema is None else f"&options={quote(f'-c search_path={schema}')}"
        place = quote(host or str(self.folder), safe="")
        return f"postgresql://tests@/postgres?host={place}&port={port or self.port}{options}"

    def empty(self, relay: Relay | None = None) -> str:
        """How a part of it is reached in which nothing is yet, past a relay if one is named."""
        schema = self.part()
        return self.past(relay, schema) if relay else self.url(schema)

    def part(self) -> str:
        """The name of a part of it in which nothing is yet."""
        self._made += 1
        schema = f"test{self._made}"
        self.do(f"CREATE SCHEMA {schema}")
        return schema

    def past(self, relay: Relay, schema: str) -> str:
        """How a part of it is reached past a relay."""
        return self.url(schema, "127.0.0.1", relay.port)

    def do(self, statement: str, url: str | None = None) -> list[tuple[object, ...]]:
        """Execute a statement with a connection of its own; the rows that it gives."""
        with psycopg.connect(url or self.url(), autocommit=True) as connection:
            cursor = connection.execute(statement.encode())
            return cursor.fetchall() if cursor.description else []

    def kill_backends(self) -> None:
        """End all that it does for others, as an administrator may."""
        self.do(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE pid <> pg_backend_pid() AND datname <> ''"
        )

    def script(self, path: Path, *arguments: object) -> subprocess.Popen[bytes]:
        """Start a script of the shell by its user, with its programs and places in the environment."""
        return subprocess.Popen(
            ["bash", path, *map(str, arguments)],
            user=self._user, group=self._user and pwd.getpwnam(self._user).pw_gid, cwd=self.folder,
            stdin=subprocess.DEVNULL,
            env={
                "PATH": f"{self._programs}:{os.environ['PATH']}", "LC_ALL": "C", "PGHOST": str(self.folder),
                "PGUSER": "tests", "PGDATA": str(self._data),
            },
        )  # fmt: skip

    def _reload(self, name: str, value: str) -> None:
        """Have it read its settings again, and return once one of them has a value."""
        self.do("SELECT pg_reload_conf()")
        while self.do(f"SHOW {name}") != [(value,)]:
            time.sleep(0.01)

    def _run(self, program: str, *arguments: str) -> None:
        done = subprocess.run(
            [str(self._programs / program), *arguments],
            user=self._user, group=self._user and pwd.getpwnam(self._user).pw_gid, cwd=self.folder,
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False,
            env={"PATH": os.environ["PATH"], "LC_ALL": "C"},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr.decode()

    def __enter__(self) -> Self:
        """Start it."""
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop it, and delete all of it."""
        if (self._data / "postmaster.pid").exists():
            self.stop("immediate")
        shutil.rmtree(self.folder)


class Relay:
    """Passes on what is sent to PostgreSQL and back, until it is to be silent."""

    def __init__(self, postgres: Postgres) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._target = str(postgres.folder / f".s.PGSQL.{postgres.port}")
        self._open = threading.Event()
        self._open.set()
        self._sockets: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def fall_silent(self) -> None:
        self._open.clear()

    def speak(self) -> None:
        self._open.set()

    def cut(self) -> None:
        """End all connections that there are."""
        for each in [*self._sockets]:
            with contextlib.suppress(OSError):  # it has ended already
                each.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._open.set()
        for each in (self._listener, *self._sockets):
            each.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listener.accept()
            except OSError:  # it is closed
                return
            far = socket.socket(socket.AF_UNIX)
            try:
                far.connect(self._target)
            except OSError:  # PostgreSQL is not there at the moment
                near.close()
                far.close()
                continue
            self._sockets += [near, far]
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=self._pass, args=(source, sink), daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        try:
            while data := source.recv(65536):
                self._open.wait()
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)
        except OSError:
            source.close()
            sink.close()


def _in_memory() -> str | None:
    """A folder that no disk has, where there is one with room: what commits, and deletes thousands of files, waits."""
    folder = "/dev/shm"
    return folder if os.access(folder, os.W_OK) and shutil.disk_usage(folder).free > _ROOM else None


def _processes() -> list[int]:
    return [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]


def _parent(number: int) -> int | None:
    """The parent of a process that has not ended; where nobody waits for it, one that has is still listed."""
    try:
        state, parent = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[:2]
    except OSError:
        return None
    return None if state == "Z" else int(parent)


def _unprivileged() -> str | None:
    """Whom it runs as where the tests are root's."""
    if os.getuid():
        return None
    names = {user.pw_name for user in pwd.getpwall()}
    return "postgres" if "postgres" in names else "nobody"
