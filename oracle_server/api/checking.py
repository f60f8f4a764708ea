"""Texts of specs that are checked over HTTP, and not stored."""

from __future__ import annotations

from functools import partial
from typing import Literal

from fastapi import HTTPException, Request, Response
from pydantic import BaseModel, Field

from oracle_server.api.leaving import text_of, unless_left
from oracle_server.api.packing import packed_answer
from oracle_server.api.routes import Routes
from oracle_server.api.specs import YAML
from oracle_server.core.errors import FindingKind
from oracle_server.core.formula.tree import Time
from oracle_server.edge.access import demand
from oracle_server.edge.scopes import needs
from oracle_server.history.port import Reading
from oracle_server.jobs.checking import Checking, CrowdedError, UncheckedError
from oracle_server.jobs.checks import Checked
from oracle_server.wire.incoming import Identifier


class FindingDocument(BaseModel):
    """An error or a warning of `check`; `line` and `column` count from 1."""

    line: int
    column: int
    message: str
    severity: Literal["error", "warning"]
    kind: FindingKind


class FormulaDocument(BaseModel):
    """A property's formula with all names written out; `time` is what its bounds count."""

    property: str
    time: Time
    formula: str


class CheckDocument(BaseModel):
    """What `check` says of a text. It is sound where no finding is an error, and has a digest then."""

    sound: bool
    digest: str
    findings: list[FindingDocument]
    formulas: list[FormulaDocument] = Field(description="As `check --formulas` prints them; none where it is not sound")


def router(checking: Checking, history: Reading) -> Routes:
    """The route that checks."""
    routes = Routes(prefix="/api/v1", tags=["specs"])

    @routes.post("/specs/{spec_id}/check", response_model=CheckDocument, openapi_extra=YAML)
    @needs("admin")
    async def check_spec(spec_id: Identifier, request: Request) -> Response:
        """Check a text that is to be the spec of an id, as `check` does, and store nothing.

        It is read in a process of its own, one text at a time; 422 where it can't be checked within 20 s.
        """
        demand(request, spec=spec_id)
        text = await text_of(request)
        try:
            found = await unless_left(request, checking.check(spec_id, text))
        except CrowdedError as error:
            raise HTTPException(429, str(error)) from None
        except UncheckedError as error:
            raise HTTPException(422, str(error)) from None
        return await packed_answer(request, history, partial(_encoded, found))

    return routes


def _encoded(found: Checked) -> bytes:
    sound = all(finding.severity != "error" for finding in found.findings)
    document = CheckDocument(
        sound=sound,
        digest=found.digest if sound else "",
        findings=[
            FindingDocument(line=f.line, column=f.column, message=f.message, severity=f.severity, kind=f.kind)
            for f in found.findings
        ],
        formulas=[FormulaDocument(**told) for told in found.formulas],
    )
    return document.model_dump_json().encode()
