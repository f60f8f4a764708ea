"""Text to tokens: names, numbers, texts and marks, each with its place."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from oracle_server.core.errors import ExpressionError

MAX_TEXT = 4096
"""Longest expression, in characters."""
_LARGEST = 2**64

_TOKEN = re.compile(
    r"""(?P<space>(?:\s+|//[^\n]*)+)
    |(?P<text>
        [rR](?:\"\"\".*?\"\"\"|'''.*?'''|"[^"\n]*"|'[^'\n]*')
        |\"\"\"(?:\\.|[^\\])*?\"\"\"|'''(?:\\.|[^\\])*?'''|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*')
    |(?P<number>0[xX][0-9a-fA-F]+[uU]?|(?:[0-9]+\.[0-9]+|[0-9]+|\.[0-9]+)(?:[eE][+-]?[0-9]+)?[uU]?)(?![A-Za-z0-9_])
    |(?P<name>[A-Za-z_][A-Za-z0-9_]*)
    |(?P<mark>===|!==|<<|>>|&&|\|\||\*\*|->|=>|=<|<>|[<>=!]=|[-+*/%<>?:()\[\]{}.,!=&|^~;])""",
    re.VERBOSE | re.DOTALL,
)
_ESCAPE = re.compile(
    r"\\(?:([abfnrtv\\?\"'`])|x([0-9a-fA-F]{2})|u([0-9a-fA-F]{4})|U([0-9a-fA-F]{8})|([0-3][0-7]{2})|(.|$))", re.DOTALL
)
_SIMPLE = dict(zip("abfnrtv", "\a\b\f\n\r\t\v", strict=True))
_NO_QUOTES = "`\u00b4\u2018\u2019\u201a\u201c\u201d\u201e\u00ab\u00bb"
_BEGUN = re.compile(r"\d[\d.]*$")
"""The beginning of a number whose end can't be read."""
_COMMENT = re.compile(r"//([^\n]*)")


class Token(NamedTuple):
    """A piece of the text; `kind` is `name`, `number`, `text`, `mark` or `end`."""

    kind: str
    text: str
    start: int
    end: int


def place(text: str, offset: int) -> tuple[int, int]:
    """The line and column of an offset, both from 1."""
    before = text[:offset]
    return before.count("\n") + 1, offset - before.rfind("\n")


def refusal(text: str, offset: int, message: str) -> ExpressionError:
    """The error that says what is wrong at an offset of the text."""
    return ExpressionError(message, *place(text, offset))


def tokens(text: str) -> list[Token]:
    """The tokens of an expression, the last one its end. Raises `ExpressionError`."""
    if len(text) > MAX_TEXT:
        raise ExpressionError(f"the expression has {len(text)} characters; at most {MAX_TEXT} are read")
    found: list[Token] = []
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            begun = _BEGUN.search(text[:at]) if text[at].isdigit() else None
            at = begun.start() if begun else at
            raise refusal(text, at, _unreadable(text[at:]))
        if match.lastgroup != "space":
            found.append(Token(match.lastgroup or "", match[0], at, match.end()))
        at = match.end()
    end = found[-1].end if found else 0
    return [*found, Token("end", "", end, end)]


def comments(text: str) -> list[tuple[int, str]]:
    """Where comments begin, and what they say."""
    found = []
    for match in _TOKEN.finditer(text):
        if match.lastgroup == "space":
            found += [(match.start() + c.start(), c[1].strip()) for c in _COMMENT.finditer(match[0])]
    return found


def text_value(text: str, token: Token) -> str:
    """What a text in quotes means. Raises `ExpressionError`."""
    word = token.text
    raw = word[0] in "rR"
    word = word[raw:]
    quotes = 3 if len(word) >= 6 and word[:3] in ('"""', "'''") else 1
    word = word[quotes:-quotes]
    if raw:
        return word

    def character(match: re.Match[str]) -> str:
        simple, *codes, octal, other = match.groups()
        if simple:
            return _SIMPLE.get(simple, simple)
        if other is not None:
            at = token.start + quotes + match.start()
            raise refusal(text, at, rf"'\{other}' is no character; write '\\{other}' for a backslash and what follows")
        number = int(octal, 8) if octal else int(next(code for code in codes if code), 16)
        if number > 0x10FFFF or 0xD800 <= number < 0xE000:
            raise refusal(text, token.start + quotes + match.start(), f"'{match[0]}' is no character")
        return chr(number)

    return _ESCAPE.sub(character, word)


def number_value(text: str, token: Token) -> float:
    """The number that a token means: whole, or real. Raises `ExpressionError`."""
    word = token.text.lower()
    if word.startswith("0x"):
        value: float = int(word.rstrip("u"), 16)
    elif any(c in word for c in ".e"):
        value = math.nan if word.endswith("u") else float(word)
    else:
        value = int(word.rstrip("u"))
    if not (math.isfinite(value) if isinstance(value, float) else value < _LARGEST):
        raise refusal(text, token.start, f"the number {token.text[:40]} is too large, or has a `u` that it can't have")
    return value


def _unreadable(rest: str) -> str:
    first = rest[0]
    if first in "'\"" or re.match(r"[rR]['\"]", rest):
        return "the text that begins here has no closing quote"
    if first in _NO_QUOTES:
        return f"'{first}' is no quote here; put a text in ' or \""
    if first.isdigit():
        word = re.match(r"[\w.]*", rest)
        unit = "; a number has neither a unit nor a type" if re.match(r"[0-9.]+[A-Za-z]+\b", rest) else ""
        return f"'{word[0] if word else first}' is no number{unit}"
    if not first.isascii() and first.isalpha():
        return f"'{first}' can't stand in a name; write msg['…'] for a field with such a name"
    shown = first if first.isprintable() else repr(first)[1:-1]
    return f"the character '{shown}' means nothing here"
