"""What is wrong inside of an atom's braces, and what to write instead."""

from __future__ import annotations

import re

from oracle_server.core.formula.around import RELATED, Around

_COMPARISONS = {"=>": ">=", "<>": "!="}
_LONGEST = 40
"""Characters of a number that is told otherwise."""
TURNED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
"""A comparison with its sides turned round."""


def of_atom(found: Around) -> str:
    """Of a text in braces; empty for any other place, and where nothing more is known of it."""
    if found.inside != "{":
        return ""
    for cause in (
        _of_word,
        _of_stream,
        _of_digits,
        _of_number,
        _of_sign,
        _of_comparison,
        _of_call,
        _of_path,
        _of_arithmetic,
        _of_beginning,
        _of_mark,
    ):
        message = cause(found)
        if message:
            return message
    return ""


def _of_word(found: Around) -> str:
    mark, before = found.next(), found.last()
    if mark in ("and", "&&", "&", "or", "||", "|"):
        word = {"&&": "and", "&": "and", "||": "or", "|": "or"}.get(mark, mark)
        comma = "; `,` between constraints means `and`" if word == "and" else ""
        return f"`{mark}` stands between atoms, not inside of one: write `{{…}} {word} {{…}}`{comma}"
    if (mark in ("not", "!") and before != "=") or before == "not" or (mark == "!=" and before in ("{", ",")):
        return "`not` stands before an atom, not inside of one: write `not {…}`, or `{flag: false}`"
    if mark == "in":
        return f"there is no `in`: write `{{{before}: A}} or {{{before}: B}}`"
    return ""


def _of_stream(found: Around) -> str:
    """A name of a stream that stands alone, or behind its key without a colon."""
    if found.next() != "/" or found.kind(1) != "word" or found.last() not in ("{", ",", "topic", "service"):
        return ""
    match = re.match(r"[\w/]+", found.text[found.at :])
    name = match[0] if match else "/"
    if found.last() in ("topic", "service"):
        return f"a `:` is missing: write `{found.last()}: {name}`"
    return f"a stream stands behind `topic:` or `service:`: write `{{topic: {name}, speed > 1}}`"


def _of_digits(found: Around) -> str:
    """A whole number as programs write it, as `0x1F` or `1_000`."""
    text = found.last() + found.next()
    if found.before[-1].kind != "number" or found.kind() != "word" or len(text) > _LONGEST:
        return ""
    try:
        return f"a number is written in decimal digits alone: write `{int(text, 0)}` for `{text}`"
    except ValueError:
        return ""


def _of_number(found: Around) -> str:
    """What stands behind a number, or is no number as it is written here."""
    mark, before = found.next(), found.last()
    if found.kind() == "number" and before == "," and found.before[-2].kind == "number":
        return f"a number is written with a point, as `{found.last(2)}.{mark}`: behind `,` begins the next constraint"
    if found.before[-1].kind != "number":
        return ""
    key = found.last(3) if found.last(2) in ("<", "<=", ">", ">=", ":", "=", "==", "!=") else ""
    if found.kind() == "word" or mark in ("%", "°"):
        alone = f"{key} {found.last(2)} {before}".replace(" :", ":") if key else before
        return f"a number has no unit: write it alone, in the unit of the signal, as `{alone}`"
    if mark in ("<", "<=", ">", ">="):
        return f"a range is two constraints: write `{{speed > {before}, speed < 5}}`"
    if mark in ("+", "-", "*", "/"):
        return ""
    return f"`{before}` and {found.shown} do not stand side by side: a number is followed by `,` or `}}`"


def _of_comparison(found: Around) -> str:
    mark, before = found.next(), found.last()
    if before == "!=" and mark == "*" and found.kind(1) == "word":
        key, name = found.last(2), found.next(1)
        equal = f"{{{key}: *{name}}}"
        mend = f"write `{{{key}: *}} and not {equal}`"
        return f"`!=` takes no variable; one stands for equal values only, as in `{equal}`; {mend}"
    if before in ("<", "<=", ">", ">=", ":", "=", "==", "!=") and mark in (".", "+") and found.kind(1) == "number":
        return f"a number is written `{'0.' if mark == '.' else ''}{found.next(1)}`"
    if before in ("<", "<=", ">", ">="):
        return of_value(before, found.next())
    if before == "!=":
        return f"`!=` compares with a text, a number, true or false, and {found.shown} is none of these"
    return ""


def of_value(op: str, text: str) -> str:
    """Of what a signal can't be compared with."""
    shown = text if len(text) <= 40 else f"{text[:40]}…"
    return f"`{op}` compares with a number or with another signal, and `{shown}` is none, as in `speed {op} limit`"


def of_bare(name: str) -> str:
    """Of a name with which the value of a variable is compared."""
    return (
        f'a variable compares with a variable, or with a value: a text stands in quotes, as `"{name}"`; the value of a '
        f"signal is bound first, as in `{{{name}: *y}} and *x < *y`"
    )


def _of_sign(found: Around) -> str:
    """A sign that is written otherwise here."""
    mark, before = found.next(), found.last()
    if before == ":" and mark == "=":
        return "there is no `:=`: write `:`"
    if before == ":" and mark in ("<", "<=", ">", ">=", "!="):
        return f"there is no `: {mark}`: write `{found.last(2)} {mark} {found.next(1)}`"
    if mark == "[" and before in (":", "=", "=="):
        return f"there are no lists in atoms: write `{{{found.last(2)}: A}} or {{{found.last(2)}: B}}`"
    if before == "=" and mark in ("!", "<"):
        return f"there is no `={mark}`: write `{mark}=`"
    return ""


def _of_call(found: Around) -> str:
    if found.next() != "(":
        return ""
    return f"there are no functions in atoms: declare a signal that is computed, as `v: {found.last()}(msg.x)`"


def _of_path(found: Around) -> str:
    """A field of a message where a signal should stand."""
    if found.next() not in (".", "[") or found.before[-1].kind != "word":
        return ""
    start = found.before[-1]
    match = re.match(r"[\w.\[\]]+", found.text[start.at :])
    path = match[0] if match else start.text
    if found.last(2) in (":", "=", "==", "!=") and not path.startswith("msg.") and "[" not in path:
        op = " !=" if found.last(2) == "!=" else ":"
        return f'a text with a dot stands in quotes: write `{found.last(3)}{op} "{path}"`; a field is a signal\'s value'
    name = re.findall(r"[^\W\d]\w*", path)[-1]
    field = path.removeprefix("msg.")
    if field == path and "." in path:
        first = path.partition(".")[0]
        stream = f"if `{first}` is its stream, write `{{topic: /{first}, {name}}}`"
        mend = f"if it is a field, declare `{name}: msg.{path}` under `signals`, and write `{name}`"
        return f"`{path}` is no name of a signal: {stream}; {mend}"
    return f"`{path}` is no name of a signal: declare `{name}: msg.{field}` under `signals`, and write `{name}`"


def _of_arithmetic(found: Around) -> str:
    mark = found.next()
    if mark not in ("+", "-", "*", "/", "%") or found.last() in ("{", ","):
        return ""
    return f"there is no arithmetic in atoms: declare a signal that is computed, as `x: msg.a {mark} msg.b`"


def _of_beginning(found: Around) -> str:
    mark = found.next()
    if found.last() in ("{", ",") and mark == "*" and found.kind(1) == "word":
        relation = f"*{found.next(1)} {found.next(2)} {found.next(3)}{found.next(4) if found.next(3) == '*' else ''}"
        if found.next(2) in RELATED:
            return f"variables are compared outside of braces: write `{{…}} and {relation}`"
        return f"a constraint begins with the signal: write `{{value: *{found.next(1)}}}`"
    if found.last() not in ("{", ",") or found.kind() != "number":
        return ""
    turned = TURNED.get(found.next(1), found.next(1))
    signal = found.next(2)
    mend = f"{signal} {turned} {mark}" if signal.isidentifier() else f"speed > {mark}"
    if signal.isidentifier() and found.next(3) in ("<", "<=", ">", ">=") and found.next(4):
        mend += f", {signal} {found.next(3)} {found.next(4)}"
    return f"a constraint begins with the signal: write `{{{mend}}}`"


def _of_mark(found: Around) -> str:
    mark, before = found.next(), found.last()
    if mark in _COMPARISONS:
        return f"there is no `{mark}`: write `{_COMPARISONS[mark]}`"
    if found.kind() in ("word", "string", "number") and before not in ("{", ",", ":", "="):
        return f"a `,`, a `:` or a comparison is missing between `{before}` and {found.shown}"
    return ""
