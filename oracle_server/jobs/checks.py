"""A process that checks texts of specs as `check` does."""

from __future__ import annotations

import resource
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from oracle_server.core.errors import Finding, SpecError
from oracle_server.process.rlimits import bound, memory
from oracle_server.process.worker import receive, send, step_back
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.lowered import Lowered, lowered

_NICE = 5
_MEMORY = 2**31
"""Bytes of address space that a check may take."""


class Request(NamedTuple):
    """The text that is to be the spec of an id."""

    id: str
    text: str


class Checked(msgspec.Struct):
    """What `check` says of it; its formulas and digest where it is sound. `error`: it could not be checked."""

    findings: Sequence[Finding] = ()
    formulas: Sequence[Lowered] = ()
    digest: str = ""
    error: str | None = None


_request = msgspec.msgpack.Decoder(Request).decode


def checked(request: Request, types: Types | None) -> Checked:
    """Check a text."""
    file = f"{request.id}.yaml"
    try:
        loaded = parse_spec(request.text, file, types=types)
    except SpecError as error:
        return Checked(error.findings)
    spec = loaded.spec
    findings = loaded.warnings
    if spec.id != request.id:
        findings = (Finding(file, 1, 1, f"its id is '{spec.id}', not '{request.id}'"), *findings)
    return Checked(findings, list(lowered(spec.properties)), spec.digest)


def main() -> None:
    """Answer on the standard output what is asked on the standard input, until its end; arguments are type folders."""
    step_back(_NICE)
    bound(resource.RLIMIT_AS, _MEMORY)
    types = Types([Path(folder) for folder in sys.argv[1:]])
    while request := receive(sys.stdin.buffer):
        try:
            answer = checked(_request(request), types)
        except MemoryError:
            answer = Checked(error=f"it needs more than {memory(_MEMORY)}")
        try:
            send(sys.stdout.buffer, answer)
        except BrokenPipeError:
            return


if __name__ == "__main__":
    main()
