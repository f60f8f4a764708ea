"""What was a formula before names, words and comparisons of signals came is the same formula still."""

from __future__ import annotations

import os
import random
import re
from functools import cache
from pathlib import Path

from lark import Lark
from lark.exceptions import LarkError

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.parse import _Builder, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula, Time
from tests import generate
from tests.engines.test_against_brute import SEED

CASES = int(os.environ.get("CASES", "1500"))
GRAMMAR = Path(__file__).with_name("formulas_before_names.lark").read_text()
SPELLINGS = {
    "not ": ("not ", "!", "! "), " and ": (" and ", "&&", " && "), " or ": (" or ", "||"), " -> ": ("->", " implies "),
    "pre ": ("pre ", "Y "), "once": ("once", "P"), "historically": ("historically", "H"), "since": ("since", "S"),
    "exists": ("exists", "E"), "forall": ("forall", "A"), ": ": (": ", "=", " == ", ":"),
    '"7"': ('"7"', "'7'", "seven"), "7": ("7", "7.0", "first", "lasting", "/cmd_vel", "~x", "true"),
    "a": ("a", "first", "once", "'a b'"),
}  # fmt: skip
"""How else the parts of a formula are written; some of what comes of it is none any more."""


@cache
def before(time: Time) -> Lark:
    return Lark(GRAMMAR, parser="lalr", lexer="contextual", transformer=_Builder(time))


def spelt(rng: random.Random, text: str) -> str:
    """The text with some of its parts written otherwise, and now and then with one left out or there twice."""
    for part, others in SPELLINGS.items():
        text = re.sub(rf"(?<!\w){re.escape(part)}", lambda _, o=others: rng.choice((o[0], *o)), text)  # type: ignore[misc]
    if rng.random() < 0.2:
        pieces = re.split(r"(\s+|[{}()\[\],])", text)
        place = rng.randrange(len(pieces))
        pieces[place] *= rng.choice((0, 2))
        text = "".join(pieces)
    return text


def test_every_formula_of_before_is_the_same_now() -> None:
    formulas = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"old {number}")
        time: Time = rng.choice(("steps", "seconds"))
        text = spelt(rng, render(generate.formula(rng, time, rng.randint(0, 4)), time))
        try:
            old: object = before(time).parse(text)
        except LarkError:
            continue
        formulas += 1
        try:
            assert isinstance(old, Formula)
            assert parse_formula(text, time) == old, text
        except FormulaError as error:
            if "variable" not in error.message:  # the tree alone does not tell what is free
                raise
    assert formulas > CASES / 3
