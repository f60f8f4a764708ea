"""What is wrong with a formula that can't be read, and what to write instead."""

from __future__ import annotations

import re

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.around import (
    BOUNDED,
    CLOSING,
    CONSTANTS,
    OPERATORS,
    QUANTIFIERS,
    RELATED,
    Around,
    first_unknown,
)
from oracle_server.core.formula.foreign import SYMBOLS, instead
from oracle_server.core.formula.misatom import TURNED, of_atom, of_value
from oracle_server.core.formula.misbound import behind, of_bound, of_displaced, of_lasting, of_variables, unbounded
from oracle_server.core.formula.names import Names
from oracle_server.core.formula.tree import Time
from oracle_server.core.nearest import nearest

_BETWEEN = "between two parts stands `and`, `or`, `since` or `->`"
_COMPARE = (*RELATED, ":")

_UNBOUNDED = {
    "pre": "pre", "Y": "pre", "not": "not", "!": "not", "next": "next", **{word: word for word in CONSTANTS},
}  # fmt: skip
_BEGINNING = (
    *("{", "(", "!", "not", "once", "pre", "historically", "eventually", "always", "next", ",", ";"),
    *CONSTANTS,
)


def misread(text: str, at: int | None, names: Names | None = None, time: Time = "steps") -> FormulaError:
    """The error for a formula that can't be read from the character `at` on, None or the length for its end.

    A word before, which could be a name and is none of these `names`, is told in its place.
    """
    names = names or Names()
    if not text.strip():
        return FormulaError("the formula is empty; write what must hold, as in `{speed > 1} -> {enabled}`")
    end = len(text.rstrip())
    at = end if at is None or at < 0 or at >= end else at
    unknown = first_unknown(text, names)
    found = Around(text, at if unknown is None else min(at, unknown), names, time)
    if found.after:
        message = _reason(found)
    elif found.open:
        message = f"the formula ends too early: {found.unclosed()}"
    else:
        message = f"the formula ends too early: something must follow `{found.last()}`"
    return FormulaError(message, *_place(text, found.at))


def _reason(found: Around) -> str:
    """Why the formula can't be read on, by the first cause that explains it."""
    causes = (
        _of_symbol, _of_comment, _of_quote, _of_arguments, _of_name, of_bound, of_displaced, of_variables,
        _of_foreign, _of_relation, _of_related, _of_brackets, of_atom,
        _of_word, _of_outside, _of_operator,
    )  # fmt: skip
    for cause in causes:
        message = cause(found)
        if message:
            return message
    if found.inside == "{":
        return f"{found.shown} is not expected here: an atom is written as {{key: value}}, or {{key > 3, flag}}"
    return f"{found.shown} is not expected here"


def _of_symbol(found: Around) -> str:
    char = found.next()[:1]
    if char == ";" and found.inside != "{":
        return ""
    return f"'{char}' is no sign of formulas; write `{SYMBOLS[char]}`" if char in SYMBOLS else ""


def _of_comment(found: Around) -> str:
    if found.next() not in ("#", "//", "--"):
        return ""
    return "there are no comments in a formula; put them into the line above `formula:`, where they begin with `#`"


def _of_quote(found: Around) -> str:
    char = found.next()[:1]
    if char in "\"'" and len(found.next()) == 1:
        return f"the quote {char} is not closed on its line"
    return ""


def _of_name(found: Around) -> str:
    """A name that is used where it can't be."""
    word, names = found.next(), found.names
    if found.inside == "{" or not word:
        return ""
    if word == names.reading:
        return f"`{word}` is defined by itself here; a name may use those above it"
    if word in names.below:
        return f"`{word}` is defined below; a name may use those above it: move it up"
    if word in names.known:
        return f"`{word}` is not expected here: {_BETWEEN}"
    if word in _COMPARE and found.last() in names.known:
        return f"`{found.last()}` stands for a formula, which holds or does not: a signal is compared in braces"
    return ""


def _of_arguments(found: Around) -> str:
    """What are no variables between the parentheses of a name."""
    if found.inside != "(" or found.opener not in found.names.known:
        return ""
    call = found.names.known[found.opener].call
    return f"between the parentheses of a name stand variables, without `*`: write `{call}`"


def _of_foreign(found: Around) -> str:
    """A word or sign of another language outside of braces, also as LaTeX writes it with a bound, `once_[0,5]`."""
    word = "[]" if (found.next(), found.next(1)) == ("[", "]") else found.next()
    plain = word.rstrip("_")
    if found.inside == "{" or word in OPERATORS:
        return ""
    told = instead(plain, found.time, behind(found))
    if told:
        return f"there is no operator `{word}`: {told}"
    if plain != word and plain in (*OPERATORS, *BOUNDED, *QUANTIFIERS):
        bound = "[2:5]" if plain in BOUNDED else ""
        return f"there is no operator `{word}`: write `{plain}{bound} {{…}}`"
    return ""


def _of_relation(found: Around) -> str:
    """Where a relation between variables has no right side, or no left one."""
    if found.inside == "{":
        return ""
    mark, last, op = found.next(), found.last(), found.next(1)
    if found.last(2) == "*" and found.last(3) not in RELATED:
        return (
            f"`*{last}` by itself is no formula: it is bound by an atom, as in `{{id: *{last}}}`, and compared, as in "
            f"`*{last} < *y` or `*{last} == 3`"
        )
    if found.kind() in ("number", "string") and op in RELATED and found.next(2) == "*":
        return f"a relation begins with the variable: write `*{found.next(3)} {TURNED.get(op, op)} {mark}`"
    if last in RELATED and found.last(3) == "*":
        return (
            f"{found.shown} is no value to compare with: write a variable, as `*y`, a number, a text in quotes, "
            "true or false"
        )
    return ""


def _of_related(found: Around) -> str:
    """What stands behind a relation that could end there."""
    if found.inside == "{" or not found.before or not (found.last(2) in RELATED or found.last(3) in RELATED):
        return ""
    mark = found.next()
    if mark in ("+", "-", "*", "/", "%"):
        return "there is no arithmetic in formulas: declare a signal that is computed, as `x: msg.a + 1`, and bind that"
    if mark in RELATED:
        return f"a range is two relations: write `… and *x {mark} {found.next(1)}`"
    return ""


def _of_brackets(found: Around) -> str:
    mark = found.next()
    if found.inside == "{" and mark == "{" == found.last():
        return "an atom stands in one pair of braces: write `{speed > 1}`"
    if found.inside == "{" and mark in (
        "->",
        "implies",
        "{",
        "since",
        "once",
        "historically",
        "until",
        "eventually",
        "always",
    ):
        return found.unclosed()
    return _of_closing(found) if mark in ("}", ")", "]") and found.kind() == "mark" else ""


def _of_closing(found: Around) -> str:
    mark = found.next()
    if found.inside == "{" and found.last() == "{":
        return "the atom `{}` is empty; write what must hold, as in `{speed > 1}`"
    if not found.open:
        return f"this `{mark}` closes nothing"
    if CLOSING[found.inside] != mark:
        return found.unclosed()
    if found.last() == "*" and found.last(2) in ("<", "<=", ">", ">="):
        return of_value(found.last(2), "*")
    return f"something is missing between `{found.last()}` and `{mark}`"


def _of_word(found: Around) -> str:
    if found.inside == "{" or found.kind() != "word" or found.next() in OPERATORS:
        return ""
    word, follows = found.next(), found.next(1)
    if follows in _COMPARE:
        atom = f"{word} {follows} {found.next(2)}".replace(" :", ":")
        return f"`{atom}` stands outside of braces: write `{{{atom}}}`"
    near = nearest(word, (*OPERATORS, *found.names.known), 0.7)
    if near:
        return f"there is no operator {'or name ' if found.names.known else ''}`{word}`; {near}"
    if found.before and found.complete:
        return f"`{word}` is not expected here: {_BETWEEN}"
    return f"`{word}` stands outside of braces: a signal is written `{{{word}}}`"


def _of_outside(found: Around) -> str:
    """What stands outside of braces, and belongs into them or nowhere."""
    mark = found.next()
    if found.inside == "{":
        return ""
    if mark in (";", ",") and not found.next(1):
        return f"a formula has no `{mark}` at its end; leave it out"
    if found.kind() == "string" or (mark == "[" and found.kind(1) == "word" and found.next(2) in _COMPARE):
        inner = mark[1:-1] if found.kind() == "string" else found.text[found.at + 1 :].partition("]")[0]
        return f"an atom stands in braces: write `{{{inner}}}`"
    if mark == "/":
        name = re.split(r"[^\w/]", found.text[found.at :], maxsplit=1)[0]
        return f"a stream stands in an atom's braces: write `{{topic: {name if len(name) > 1 else '/cmd_vel'}}}`"
    if found.kind() == "number" and found.complete:
        return f"`{mark}` is not expected here: a time or a number of steps stands in a bound, as in `once[:5] {{…}}`"
    return ""


def _of_operator(found: Around) -> str:
    mark, last = found.next(), found.last()
    if last == "lasting" and found.inside != "{":
        return of_lasting(found.text[found.at + 1 :].partition(")")[0] if mark == "(" else mark)
    if found.inside != "{" and re.fullmatch(r"[-=]+>", mark) and mark != "->":
        return f"there is no operator `{mark}`: write `->`"
    if mark in _BEGINNING and found.complete:
        return f"`{mark}` is not expected here: {_BETWEEN}"
    if mark in ("and", "or", "->", "since", "until", "implies", "&&", "||"):
        first = f"after `{last}`" if found.before else "at the beginning"
        return f"something is missing {first}: `{mark}` stands between two parts, as in `{{a}} {mark} {{b}}`"
    return _of_useless_bound(found)


def _of_useless_bound(found: Around) -> str:
    """A bound behind what has none, or has one already."""
    mark, last = found.next(), found.last()
    if mark == "[" and last == "]":
        return "an operator has one bound"
    if mark == "[" and last in _UNBOUNDED:
        return unbounded(_UNBOUNDED[last], found.text[found.at + 1 :].partition("]")[0])
    if mark == "[" or (last in BOUNDED and mark in ("<", "<=", ">", ">=", "_", "^")):
        word = last if last in BOUNDED else "once"
        words = "`once`, `historically`, `since`, `eventually`, `always` or `until`"
        return f"a bound stands after {words}, in square brackets, as in `{word}[:5] {{…}}`"
    return ""


def _place(text: str, at: int) -> tuple[int, int]:
    return (text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at))
