"""What `check` finds, in the formats of those who read it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from enum import StrEnum
from pathlib import PurePath
from typing import Any
from urllib.parse import quote

from oracle_server import __version__
from oracle_server.core.errors import Finding
from oracle_server.specfiles.annotations import annotation

_KINDS = {
    "general": "What makes a spec unsound, or hardly mean what it says",
    "type": "A type, or what is read of its messages",
    "unjudged": "What leaves a property unknown",
    "vacuous": "A part of a formula that never holds, or never fails",
}


class FindingsFormat(StrEnum):
    """The format of what is found."""

    TEXT = "text"
    JSON = "json"
    GITHUB = "github"
    SARIF = "sarif"


def as_json(finding: Finding) -> str:
    """A finding as a line of JSON."""
    return json.dumps(asdict(finding), ensure_ascii=False)


def as_annotation(finding: Finding) -> str:
    """A finding as GitHub's workflow command, which marks the line in a pull request."""
    return annotation(finding.severity, finding.file, (finding.line, finding.column), finding.message)


def as_sarif(findings: Iterable[Finding]) -> str:
    """Findings as a SARIF 2.1.0 document, as code scanning takes them."""
    rules = [{"id": kind, "shortDescription": {"text": text}} for kind, text in _KINDS.items()]
    run = {
        "tool": {"driver": {"name": "oracle-server", "version": __version__, "rules": rules}},
        "columnKind": "unicodeCodePoints",
        "results": [_result(finding) for finding in findings],
    }
    schema = "https://json.schemastore.org/sarif-2.1.0.json"
    return json.dumps({"$schema": schema, "version": "2.1.0", "runs": [run]}, indent=2, ensure_ascii=False)


def _result(finding: Finding) -> dict[str, Any]:
    path = PurePath(finding.file)
    uri = path.as_uri() if path.is_absolute() else quote(path.as_posix())
    place = {
        "artifactLocation": {"uri": uri},
        "region": {"startLine": finding.line, "startColumn": finding.column},
    }
    return {
        "ruleId": finding.kind,
        "level": finding.severity,
        "message": {"text": finding.message},
        "locations": [{"physicalLocation": place}],
    }
