"""What `check` finds, for editors, pull requests and code scanning."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import yaml

from oracle_server.cli.findings import as_annotation, as_sarif
from oracle_server.core.errors import Finding
from tests.processes import ROOT
from tests.whole.harness import run

SPEC = """id: bad
streams:
  - topic: /a
    type: nowhere_msgs/msg/Bool
properties:
  - {id: p, formula: '{data} ->'}
"""
HOSTILE = Finding("a,b: c.yaml", 3, 7, "100% wrong\n::error::forged", "warning")


def test_a_file_s_findings_are_annotations(tmp_path: Path) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(SPEC, encoding="utf-8")
    found = run("check", file, "--format", "github")
    assert found.returncode == 1
    lines = found.stdout.splitlines()
    assert [line for line in lines if line.startswith(f"::error file={file},line=6,col=")]
    assert lines[-1].startswith("0 specs sound, 1 error")


def test_no_message_ends_an_annotation_or_begins_another() -> None:
    line = as_annotation(HOSTILE)
    assert "\n" not in line
    assert line.startswith("::warning file=a%2Cb%3A c.yaml,line=3,col=7::100%25 wrong")


def test_sarif_says_what_where_and_how_bad() -> None:
    other = Finding("/x/y z.yaml", 1, 1, "it is not there", "error", "type")
    (sarif,) = json.loads(as_sarif([HOSTILE, other]))["runs"]
    rules = {rule["id"] for rule in sarif["tool"]["driver"]["rules"]}
    first, second = sarif["results"]
    assert {first["ruleId"], second["ruleId"]} <= rules
    assert (first["level"], second["level"]) == ("warning", "error")
    assert first["message"]["text"] == HOSTILE.message
    place = first["locations"][0]["physicalLocation"]
    assert place["artifactLocation"]["uri"] == "a%2Cb%3A%20c.yaml"
    assert place["region"] == {"startLine": 3, "startColumn": 7}
    assert second["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] == "file:///x/y%20z.yaml"


def test_sarif_is_one_document_of_all_files(tmp_path: Path) -> None:
    files = [tmp_path / "a.yaml", tmp_path / "b.yaml"]
    for file in files:
        file.write_text(SPEC, encoding="utf-8")
    found = run("check", *files, "--format", "sarif")
    assert found.returncode == 1
    (sarif,) = json.loads(found.stdout)["runs"]
    assert {result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] for result in sarif["results"]} == {
        file.as_uri() for file in files
    }


def test_the_hook_for_pre_commit_is_one() -> None:
    manifest = ROOT / ".pre-commit-hooks.yaml"
    subprocess.run([sys.executable, "-m", "pre_commit", "validate-manifest", manifest], check=True)
    (hook,) = yaml.safe_load(manifest.read_text(encoding="utf-8"))
    program, *arguments = hook["entry"].split()
    assert program == "oracle-server"
    assert run(*arguments, ROOT / "specs/battery_uav.yaml").returncode == 0
