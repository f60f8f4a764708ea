"""The parameters by which records are selected."""

from __future__ import annotations

import inspect

import pytest
from fastapi.dependencies.utils import get_dependant
from fastapi.routing import APIRoute

from oracle_server.api import questions


def asked(outcome: questions.Outcomes) -> None:
    """A route's question."""


@pytest.mark.parametrize("parameters", [questions.chosen, asked])
def test_a_question_needs_no_signature_to_be_parsed(parameters: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """The signature of a function in C is a text: to parse it takes half a millisecond, at each request."""
    route = APIRoute("/", parameters)  # type: ignore[arg-type]
    fields = get_dependant(path="/", call=route.endpoint).query_params

    def parsed(*_: object, **__: object) -> None:
        raise AssertionError

    monkeypatch.setattr(inspect, "_signature_fromstr", parsed)
    assert [] in [field.get_default() for field in fields]
