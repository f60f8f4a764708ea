"""Texts that expressions read as numbers."""

from __future__ import annotations

import pytest

from oracle_server.core.expression import parse_expression, reason


@pytest.mark.parametrize("text", ["\N{LATIN SMALL LETTER DOTLESS I}nf", "\N{LATIN CAPITAL LETTER I WITH DOT ABOVE}nf",
                                  "\N{ARABIC-INDIC DIGIT ONE}", "1 ", ""])  # fmt: skip
def test_of_a_text_that_is_no_number_it_is_said_that_it_is_none(text: str) -> None:
    told = reason(parse_expression("double(msg.data)"), {"data": text}, 1000)
    assert "`double` takes a number, or a text that is one" in told
