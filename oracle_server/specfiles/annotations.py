"""Lines of specs as GitHub's workflow commands mark them in a pull request."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

from oracle_server.core.errors import one_line

if TYPE_CHECKING:
    from oracle_server.specfiles.document import Position


def annotation(severity: Literal["error", "warning"], file: str, place: Position, message: str) -> str:
    """A workflow command, in one line, that marks a place (line and column, from 1) of a file with a message."""
    line, column = place
    return f"::{severity} file={_value(file)},line={line},col={column}::{_data(one_line(message))}"


def remark(message: str) -> str:
    """A workflow command, in one line, for an error that is at no place of a file."""
    return f"::error::{_data(one_line(message))}"


def property_places(text: str) -> Mapping[str, Position]:
    """Where the id of each property stands in the text of a sound spec."""
    from oracle_server.specfiles.document import read_yaml

    document = read_yaml(text, "spec")
    return {
        each["id"]: document.place(("properties", index, "id"))
        for index, each in enumerate(document.value["properties"])
    }


def _data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _value(text: str) -> str:
    """A property of a workflow command, in which these mark the end."""
    return _data(text).replace(":", "%3A").replace(",", "%2C")
