"""Specs are stored in a running server by a command."""

from __future__ import annotations

from pathlib import Path

from tests.whole.harness import Server, failed, run

SPEC = """id: {id}
streams:
  - topic: /a
    type: nowhere_msgs/msg/A
properties:
  - {{id: p, formula: 'not {{v: {value}}}'}}
"""


def test_a_spec_is_stored_and_replaced(server: Server, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    for value in (1, 2):
        file.write_text(SPEC.format(id="mine", value=value), encoding="utf-8")
        put = run("put", file, "--url", server.url)
        assert (put.returncode, put.stdout) == (0, f"{file}: stored as mine; open sessions keep theirs\n")
        assert "nowhere_msgs is not known" in put.stderr
        assert server.get("specs/mine")["properties"][0]["formula"] == f"not {{v: {value}}}"


def test_nothing_is_stored_where_one_of_them_is_unsound(server: Server, tmp_path: Path) -> None:
    good, bad = tmp_path / "good.yaml", tmp_path / "bad.yaml"
    good.write_text(SPEC.format(id="good", value=1), encoding="utf-8")
    bad.write_text(SPEC.format(id="bad", value="]"), encoding="utf-8")
    put = run("put", good, bad, "--url", server.url)
    assert put.returncode == 2
    assert f"{bad}:6:" in put.stderr
    assert not {"good", "bad"} & {spec["id"] for spec in server.get("specs")["items"]}


def test_what_the_server_refuses_is_told(server: Server, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(SPEC.format(id="mine", value=1), encoding="utf-8")
    away = failed("put", file, "--url", "http://ops:s3cret@127.0.0.1:1")
    assert "http://…@127.0.0.1:1: can't be reached" in away
    assert "s3cret" not in away
    assert "can't be read" in failed("put", tmp_path / "none.yaml", "--url", server.url)
