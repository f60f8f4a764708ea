"""The types of the server's frames are those of the documented models."""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import Any, Literal, NotRequired, Union, get_args, get_origin, get_type_hints, is_typeddict

import pytest
from pydantic import BaseModel

from oracle_server.core import records
from oracle_server.core.records import AboutRecord, ExplanationRecord
from oracle_server.core.verdicts import Outcome
from oracle_server.wire import frames, outgoing

MODELS: dict[str, type[BaseModel]] = {model.__name__: model for model in get_args(get_args(outgoing.Outgoing)[0])}
PARTS: dict[str, type[BaseModel]] = {
    model.__name__: model
    for model in (
        outgoing.StreamFrame,
        outgoing.Limits,
        outgoing.PropertyStanding,
        outgoing.CauseRecord,
        outgoing.RevisesRecord,
    )
}


def plain(hint: Any) -> Any:
    """A type as both ways to write it have it: models and typed dicts by name, outcomes as their texts."""
    if hint is Outcome:
        return str
    if hint in (ExplanationRecord, AboutRecord):
        return plain(dict[str, Any])
    if is_typeddict(hint) or (isinstance(hint, type) and issubclass(hint, BaseModel)):
        return hint.__name__
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return frozenset(plain(argument) for argument in arguments)
    if origin is Literal:
        return Literal, frozenset(arguments)
    if origin is Mapping:
        return dict, *map(plain, arguments)
    return (origin, *map(plain, arguments)) if origin else hint


def test_each_frame_has_a_model() -> None:
    assert {frame.__name__ for frame in get_args(frames.Outgoing)} == set(MODELS)


@pytest.mark.parametrize("name", [*MODELS, *PARTS])
def test_a_frame_and_its_model_say_the_same(name: str) -> None:
    typed_dict = getattr(frames, name, None) or getattr(records, name)
    hints, model = get_type_hints(typed_dict, include_extras=True), (MODELS | PARTS)[name]
    fields = {field.alias or key: field for key, field in model.model_fields.items()}
    modelled = {key: plain(field.annotation) for key, field in fields.items()}
    optional = {key for key, hint in hints.items() if get_origin(hint) is NotRequired}
    assert optional == {key for key, field in fields.items() if not field.is_required()}
    typed = {key: plain(get_args(hint)[0] if key in optional else hint) for key, hint in hints.items()}
    of_some = {"explanation", "outcome"} if name == "ViolationFrame" else set()  # other records may have none
    loose = optional | of_some
    for key in loose:  # a model has None for what is not there
        typed[key], modelled[key] = or_none(typed[key]), or_none(modelled[key])
    assert typed == modelled


def or_none(hint: Any) -> Any:
    return (hint if isinstance(hint, frozenset) else frozenset({hint})) | {type(None)}
