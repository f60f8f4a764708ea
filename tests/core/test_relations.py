"""Relations between variables: what is read, what is refused, with its place."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula import tree
from oracle_server.core.formula.definitions import defined
from oracle_server.core.formula.outline import outline
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Ref, Relation, walk
from oracle_server.engines.reelay import refusal

READ = [
    "forall[x]. forall[y]. {speed: *x} and pre {speed: *y} -> *x <= *y",
    'forall[f]. {write: *f} -> (exists[m]. not {close: *f} since ({open: *f, mode: *m} and *m != "r"))',
    "exists[x]. exists[y]. {level: *x} and once {limit: *y} and *x > *y",
    "exists[x]. {level: *x} and (exists[y]. once {limit: *y} and *x > *y)",
    "forall[x]. {a: *x} -> (forall[y]. {b: *y} -> (exists[z]. {c: *z} and *x > *y))",
    "exists[x]. {a: *x} and (*x == 3 or {b: *x})",
    "exists[x]. {a: *x} and not *x == true",
    "forall[x]. not {a: *x} or *x >= 2.5",
    "forall[x]. *x < 3 or not {a: *x}",
    "forall[x]. not ({a: *x} and not *x < -3)",
    "exists[x]. ({a: *x} or {b: *x}) and *x != '\"'",
    "exists[x]. pre ({a: *x} and *x == false)",
    "forall[x]. {a: *x} -> {b: *x} -> *x < 3",
    "forall[x]. *x < 3 -> not {a: *x}",
    "exists[x]. {b: *x} and historically ({a: *x} -> *x > 3)",
    "exists[x]. ({a: *x} -> *x > 3) since {b: *x}",
    "forall[x]. {a: *x} and *x > 3 -> eventually[:5] {b: *x}",
]


@pytest.mark.parametrize("text", READ)
def test_what_is_printed_is_read_as_the_same(text: str) -> None:
    formula = parse_formula(text)
    assert render(formula) == text
    assert parse_formula(render(formula)) == formula


def test_the_tree() -> None:
    (found,) = (n for n in walk(parse_formula("exists[x].\n {a: *x} and * x = 1")) if isinstance(n, Relation))
    assert found == Relation(Ref("x"), "==", 1)
    assert found != Relation(Ref("x"), "==", True)
    assert found.at == (2, 14)
    assert found.variables == ("x",)


@pytest.mark.parametrize(
    ("text", "place", "says"),
    [
        ("exists[x]. *x == 3", (1, 12), "nothing that holds beside it binds 'x'"),
        ("exists[x]. {a: *x} or *x == 3", (1, 23), "write it behind an atom that does"),
        ("exists[x]. not {a: *x} and *x == 3", (1, 28), "nothing that holds beside it binds 'x'"),
        ("forall[x]. {a: *x} -> once *x == 3", (1, 28), "within the same `once`, `since` or `pre`"),
        (
            "forall[k]. {a: *k} -> historically (forall[y]. {r: *y} -> *y < *k)",
            (1, 59),
            "a relation has no time: write it there, as in `once {value: *y} and *y < *k`",
        ),
        ("forall[x]. {a: *x} -> once *x == 3", (1, 28), "write it there, as in `{value: *x} and *x == 3`"),
        ("exists[x]. {a: *x} and once (exists[x]. *x == 3 and {b})", (1, 41), "write it behind an atom that does"),
        ("forall[x]. *x == 3 -> {a: *x}", (1, 12), "nothing that holds beside it binds 'x'"),
        ("forall[x]. {a: *x} since *x == 3", (1, 26), "nothing that holds beside it binds 'x'"),
        ("forall[x]. (*x == 3) since {a: *x}", (1, 13), "nothing that holds beside it binds 'x'"),
        ("exists[x]. (exists[y]. {b: *y} and *x > *y) and {a: *x}", (1, 36), "nothing that holds beside it binds 'x'"),
        ("exists[x]. {a: *x} and once (exists[y]. {b: *y} and *x > *y)", (1, 53), "binds 'x'"),
        ("exists[x]. {a: *x} and exists[y]. {b: *x} and *x > *y", (1, 47), "binds 'y'"),
        ("exists[x]. exists[y]. {a: *x} and ({b: *y} or *x > *y)", (1, 47), "binds 'y'"),
        ("exists[x]. once[2:] not once {a: *x} and *x > 3", (1, 42), "binds 'x'"),
        ("exists[x]. {a: *x} and *x < *y", (1, 24), "the variable 'y' is free"),
        ("exists[x]. {a: *x} and *x < *x", (1, 24), "`*x` is compared with itself"),
        ("exists[x]. {a: *x} and *x < speed", (1, 29), 'a text stands in quotes, as `"speed"`'),
        ("exists[x]. {a: *x} and *x and {b}", (1, 27), "`*x` by itself is no formula"),
        ("exists[x]. {a: *x} and *x", (1, 26), "the formula ends too early"),
        ("exists[x]. {a: *x} and *x < {b}", (1, 29), "`{` is no value to compare with"),
        ("exists[x]. {a: *x} and *x < *x + 1", (1, 32), "there is no arithmetic in formulas"),
        ("exists[x]. {a: *x} and *x < 3 - 1", (1, 31), "there is no arithmetic in formulas"),
        ("exists[x]. {a: *x} and 3 <= *x", (1, 24), "write `*x >= 3`"),
        ("exists[x]. {a: *x} and *x < 3 < 4", (1, 31), "a range is two relations: write `… and *x < 4`"),
        ("exists[x]. {a: *x} and {*x < 3}", (1, 25), "outside of braces: write `{…} and *x < 3`"),
        ("exists[x]. {a: *x} and {*x}", (1, 25), "write `{value: *x}`"),
        ("exists[x]. {a: *x} and {b < *x}", (1, 24), "as `{b: *y} and *y < *x`"),
        ("forall[x]. {a: *x} -> eventually[:5] ({b: *x} and *x > 3)", (1, 51), "stands in what is awaited"),
        ("forall[x]. {a: *x} and once *x > 3 -> eventually[:5] {b: *x}", (1, 29), "binds 'x'"),
    ],
)
def test_what_is_refused_and_where(text: str, place: tuple[int, int], says: str) -> None:
    with pytest.raises(FormulaError) as refused:
        parse_formula(text)
    assert says in refused.value.message
    assert (refused.value.line, refused.value.column) == place


def test_a_name_may_stand_for_one_where_it_is_used_beside_what_binds() -> None:
    names = defined({"more(a, b)": "*a > *b"}, [])
    found = parse_formula("forall[y, a]. {v: *y} and pre {v: *a} -> more(y, a)", names=names)
    assert render(found) == "forall[y]. forall[a]. {v: *y} and pre {v: *a} -> *y > *a"
    with pytest.raises(FormulaError, match="binds 'b'"):
        parse_formula("exists[a, b]. {v: *a} and more(a, b) or {v: *b}", names=names)


def test_a_relation_is_a_row_of_its_own() -> None:
    rows = outline(parse_formula("forall[x]. {v: *x} -> *x > 3"), "steps", 9)
    assert [row.head for row in rows] == ["forall[x].", "->", "{v: *x}", "*x > 3"]
    assert rows[-1].needs == ("x",)


def test_reelay_refuses_them() -> None:
    assert "compares the values of variables" in (refusal(parse_formula("forall[x]. {v: *x} -> *x > 3"), "steps") or "")


def test_values_of_different_kinds_are_different_relations() -> None:
    same = tree.Since(Relation(Ref("x"), "==", 1), Relation(Ref("x"), "==", True), tree.Bound(2))
    assert tree.lasted(same) is None
