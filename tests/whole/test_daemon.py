"""The server in the background: started, asked how it is, and stopped."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from inspect import signature
from pathlib import Path

import pytest

from oracle_server.cli import commands, serving
from oracle_server.process import daemon
from oracle_server.process.daemon import _ON_THE_COMMAND_LINE, DaemonError
from oracle_server.process.pidfile import NAME, PidFile, running
from oracle_server.process.settings import Settings, load_settings
from tests.whole.conftest import copy_specs
from tests.whole.harness import COMMAND, PATIENCE, Server, failed, run


@pytest.fixture
def data(tmp_path: Path) -> Iterator[Path]:
    """A data directory in which no server is left at the end."""
    folder = tmp_path / "data"
    yield folder
    left = running(folder)
    if left is not None:
        os.kill(left.pid, signal.SIGKILL)


@pytest.fixture
def specs(tmp_path: Path) -> Path:
    return copy_specs(tmp_path / "specs")


def start(data: Path, specs: Path, **settings: str) -> str:
    """Start a server, and tell its address."""
    ended = run("start", "--data-dir", data, "--specs", specs, "--port", "0", **settings)
    assert (ended.returncode, ended.stderr) == (0, ""), ended
    return ended.stdout.split(": ")[0]


def test_it_starts_tells_how_it_is_and_stops(data: Path, specs: Path) -> None:
    assert run("status", "--data-dir", data).returncode == 3
    url = start(data, specs)
    told = run("status", "--data-dir", data, "--json")
    assert told.returncode == 0
    status = json.loads(told.stdout)
    assert (status["state"], status["url"]) == ("ready", url)
    assert str(status["pid"]) in run("status", "--data-dir", data).stdout
    assert "lamp" in run("specs", "--url", url).stdout
    assert "accepting work" in (data / "server.log").read_text()
    stopped = run("stop", "--data-dir", data)
    assert (stopped.returncode, stopped.stdout) == (0, f"{url}: stopped\n")
    assert run("status", "--data-dir", data).returncode == 3
    assert run("stop", "--data-dir", data).returncode == 0
    assert running(data) is None


def test_it_starts_whatever_the_folder_of_temporary_files_is_called(data: Path, specs: Path, tmp_path: Path) -> None:
    """The socket on which it tells that it is ready has a path, which may not be long."""
    long = tmp_path / ("long" * 25)
    long.mkdir()
    start(data, specs, TMPDIR=str(long))
    assert run("stop", "--data-dir", data).returncode == 0


def test_it_starts_where_no_folder_for_temporary_files_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where all but its data directory is mounted read-only; what needs such a folder says how one is named."""
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(tempfile, "_candidate_tempdir_list", lambda: [str(tmp_path / "nowhere")])
    with daemon._readiness(tmp_path) as (listener, address):
        assert Path(address).parent.parent == tmp_path
        assert listener.getsockname() == address
    with pytest.raises(FileNotFoundError) as none:
        tempfile.gettempdir()
    assert commands._reason(none.value).endswith("; name a folder that you can write by TMPDIR")


def test_it_starts_in_a_folder_with_modules_of_the_same_names(
    data: Path, specs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of a robot's package are called `yaml.py` and `queue.py`, too; another version's checkout, like this."""
    folder = tmp_path / "mine"
    (folder / "oracle_server").mkdir(parents=True)
    for name in ("oracle_server/__init__.py", "yaml.py", "queue.py", "typing_extensions.py"):
        (folder / name).write_text("raise SystemExit('this is not what is meant')\n", encoding="utf-8")
    monkeypatch.chdir(folder)
    start(data, specs)
    assert run("stop", "--data-dir", data).returncode == 0


def test_ctrl_c_while_it_starts_ends_the_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It came up in the background, and nothing was said of it."""
    launched = []

    def interrupted(process: subprocess.Popen[bytes], *_: object) -> str:
        launched.append(process)
        raise KeyboardInterrupt

    monkeypatch.setattr(daemon, "_wait_until_ready", interrupted)
    with pytest.raises(KeyboardInterrupt):
        daemon.launch({**os.environ, "ORACLE_DATA_DIR": str(tmp_path), "ORACLE_PORT": "0"}, tmp_path / "log", 1.0)
    (server,) = launched
    ended = server.poll()
    server.kill()
    assert ended in (0, -signal.SIGTERM)


def test_a_server_that_could_write_no_reason_is_told_as_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the disk is full: the log that was named was empty."""
    monkeypatch.setattr(daemon, "command", lambda *_: (["false"], {"PYTHONPATH": ""}))
    with pytest.raises(daemon.DaemonError, match="log, as on a full disk; `serve` says why"):
        daemon.launch(os.environ, tmp_path / "log", 60.0)


def test_what_is_said_on_the_command_line_is_heard(data: Path, specs: Path) -> None:
    """Every option that `start` shares with `serve` reaches the server that it starts."""
    shared = {*signature(serving.serve).parameters} & {*signature(serving.start).parameters} & {*Settings.model_fields}
    assert shared == {*_ON_THE_COMMAND_LINE, "data_dir"}
    given = ("--data-dir", data, "--specs", specs, "--port", "0")
    assert "nowhere" in failed("start", *given, "--legacy", "nowhere")
    assert run("start", *given, "--legacy", "lamp").returncode == 0
    assert run("stop", "--data-dir", data).returncode == 0


def test_it_is_ready_only_once_its_sessions_are_back(data: Path, specs: Path) -> None:
    url = start(data, specs)
    for _ in range(2):
        run("stop", "--data-dir", data)
        url = start(data, specs, ORACLE_LOG="json")
        lines = [json.loads(line) for line in (data / "server.log").read_text().splitlines() if line.startswith("{")]
        assert lines[-1]["event"] == "accepting work"
    assert run("sessions", "--url", url).returncode == 0


def test_a_second_one_is_not_started(data: Path, specs: Path) -> None:
    url = start(data, specs)
    assert "runs already" in failed("start", "--data-dir", data)
    assert "uses this data directory" in failed("serve", "--data-dir", data, "--port", "0")
    port = url.rpartition(":")[2]
    message = failed("start", "--data-dir", data.with_name("other"), "--specs", specs, "--port", port)
    assert "Address already in use; stop what uses it, or choose another --port" in message
    assert json.loads(run("status", "--data-dir", data, "--json").stdout)["url"] == url


def test_the_pid_file_of_one_that_was_killed_deceives_nobody(data: Path, specs: Path) -> None:
    start(data, specs)
    server = running(data)
    assert server is not None
    os.kill(server.pid, signal.SIGKILL)
    deadline = PATIENCE / 0.01
    while running(data) is not None:
        deadline -= 1
        assert deadline
        signal.sigtimedwait([], 0.01)
    assert (data / "server.pid").read_text().startswith(str(server.pid))
    assert run("status", "--data-dir", data).returncode == 3
    assert run("stop", "--data-dir", data).returncode == 0
    start(data, specs)


def test_who_has_the_number_here_of_a_server_elsewhere_is_not_ended(data: Path) -> None:
    """In a container processes have numbers of their own; its volume is seen from outside."""
    with subprocess.Popen(["sleep", "1h"]) as bystander:
        server = PidFile(data)
        (data / NAME).write_text(f"{bystander.pid}\nhttp://127.0.0.1:1\n")
        told = failed("stop", "--data-dir", data)
        server.release()
        ended = bystander.poll()
        bystander.kill()
    assert ended is None
    assert f"(pid {bystander.pid} there): stop it where it was started" in told


def test_how_a_server_elsewhere_stands_is_not_asked_of_the_one_that_has_its_address_here(
    data: Path, specs: Path, tmp_path: Path
) -> None:
    url = start(data, specs)
    volume = tmp_path / "volume"
    with subprocess.Popen(["sleep", "1h"]) as bystander:
        elsewhere = PidFile(volume)
        (volume / NAME).write_text(f"{bystander.pid}\n{url}\n")
        told, document = run("status", "--data-dir", volume), run("status", "--data-dir", volume, "--json")
        elsewhere.release()
        bystander.kill()
    assert told.stdout.startswith(f"{url}: running (pid {bystander.pid} there: it is no process here")
    assert (told.returncode, json.loads(document.stdout)["state"]) == (0, "running")


def test_one_at_all_addresses_is_asked_where_ipv6_is_switched_off(data: Path, specs: Path, tmp_path: Path) -> None:
    port = start(data, specs).rpartition(":")[2]  # where IPv4 alone is listened at, as is all that can be reached then
    everywhere = PidFile(tmp_path / "everywhere")
    everywhere.publish(f"http://[::]:{port}")
    told = run("status", "--data-dir", tmp_path / "everywhere", "--ready")
    everywhere.release()
    assert (told.returncode, told.stdout) == (0, f"http://[::]:{port}: ready (pid {os.getpid()})\n")


def test_it_tells_that_it_has_no_spec_or_one_that_is_unsound(data: Path, tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()

    def told() -> str:
        started = run("start", "--data-dir", data, "--specs", folder, "--port", "0")
        assert (started.returncode, run("stop", "--data-dir", data).returncode) == (0, 0)
        return started.stderr

    assert told() == f"oracle-server: there is no spec yet: {folder} has no *.yaml; name another folder by --specs\n"
    (folder / "bad.yaml").write_text("id: bad\n")
    assert (
        told() == "oracle-server: 1 of 1 specs are unsound, and can't be used: bad; `oracle-server specs` tells why\n"
    )


def test_what_keeps_it_from_starting_is_told(data: Path, specs: Path, tmp_path: Path) -> None:
    assert "is no folder" in failed("start", "--data-dir", data, "--specs", tmp_path / "nowhere", "--port", "0")
    told = failed("start", "--data-dir", data, "--specs", specs, "--port", "0", "--legacy", "nowhere")
    assert "there is no spec 'nowhere'" in told
    (tmp_path / "file").write_text("")
    assert "can't be" in failed("start", "--data-dir", tmp_path / "file", "--specs", specs, "--port", "0")


def test_a_place_that_can_not_be_written_is_told(specs: Path) -> None:
    for place in ("/proc/nowhere", "/dev/null"):
        assert f"{place}: can't be used as data directory" in failed("serve", "--data-dir", place, "--port", "0")
        assert place in failed("start", "--data-dir", place, "--port", "0")
    assert "name a folder of yours by --data-dir" in failed("start", "--data-dir", "/proc/nowhere", "--port", "0")


def test_a_pipe_in_the_place_of_its_log_is_told(data: Path) -> None:
    """To open it would wait for who reads it, without an end."""
    data.mkdir()
    os.mkfifo(data / daemon.LOG)
    with pytest.raises(DaemonError, match=r"server\.log: is a pipe"):
        daemon.start(load_settings(data_dir=data), PATIENCE)


def test_what_was_to_be_done_is_done_where_nothing_can_be_printed(data: Path) -> None:
    with open("/dev/full", "wb") as full:
        arguments = [str(COMMAND), "stop", "--data-dir", str(data)]
        ended = subprocess.run(arguments, stdout=full, stderr=subprocess.PIPE, encoding="utf-8", check=False)
    why = "standard output can't be written: No space left on device"
    assert (ended.returncode, ended.stderr) == (0, f"oracle-server: {data}: no server runs; {why}\n")


def test_too_few_files_are_told(data: Path, specs: Path) -> None:
    limited = ["sh", "-c", 'ulimit -n 15; exec "$@"', "sh", str(COMMAND)]
    arguments = [*limited, "serve", "--data-dir", str(data), "--specs", str(specs)]
    ended = subprocess.run(arguments, capture_output=True, encoding="utf-8", check=False)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert ended.stderr == (
        "oracle-server: no more than 15 files may be open at once: allow more (`ulimit -n`, `LimitNOFILE=`)\n"
    )


def test_systemd_is_told_how_it_stands(data: Path, specs: Path, tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(PATIENCE)
        with Server(specs, data, NOTIFY_SOCKET=str(tmp_path / "notify"), WATCHDOG_USEC="100000") as server:
            told = [listener.recv(100) for _ in range(4)]
            with ThreadPoolExecutor() as threads:
                stopped = threads.submit(server.stop)
                while told[-1] != b"STOPPING=1":  # few may wait to be heard
                    told.append(listener.recv(100))
                assert stopped.result() == 0
    assert b"READY=1" in told
    assert set(told) == {b"READY=1", b"WATCHDOG=1", b"STOPPING=1"}
