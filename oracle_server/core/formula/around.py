"""The text around the place where a formula can't be read on: its tokens, and the brackets that are open."""

from __future__ import annotations

import re
from collections.abc import Iterator

from oracle_server.core.formula.names import Names
from oracle_server.core.formula.tree import Time

CLOSING = {"{": "}", "(": ")", "[": "]"}
"""What closes each bracket."""
CONSTANTS = ("true", "false", "first")
"""The words that are whole formulas."""
OPERATORS = (
    *("not", "and", "or", "implies", "pre", "once", "historically", "since", "forall", "exists", "lasting"),
    *("eventually", "always", "until", "next"),
    *CONSTANTS,
)
"""The words of formulas."""
BOUNDED = ("once", "historically", "since", "P", "H", "S", "eventually", "always", "until")
"""Those behind which a bound can stand."""
AHEAD = ("eventually", "always", "until")
"""Those of them that wait for what comes."""
QUANTIFIERS = ("forall", "exists", "A", "E")
"""Those behind which variables stand."""

RELATED = ("<", "<=", ">", ">=", "==", "!=", "=")
"""What stands between the variables of a relation."""
WORDS = frozenset({*OPERATORS, *BOUNDED, *QUANTIFIERS, "Y"})
"""All words that are operators, and the letters that stand for some."""

_TOKEN = re.compile(
    r"""(?P<space>\s+)
    |(?P<string>"[^"\n]*"|'[^'\n]*')
    |(?P<word>[^\W\d]\w*)
    |(?P<number>-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)
    |(?P<mark><->|<=>|[-=~|]+>|<>|[<>=!]=|&&|\|\||//|--|.)""",
    re.VERBOSE | re.DOTALL,
)


class Token:
    """A piece of the text, with its place."""

    def __init__(self, kind: str, text: str, at: int) -> None:
        self.kind, self.text, self.at = kind, text, at


class Around:
    """The text around one place of it."""

    def __init__(self, text: str, at: int, names: Names | None = None, time: Time = "steps") -> None:
        self.text, self.at, self.names, self.time = text, at, names or Names(), time
        tokens = [t for t in _tokens(text) if t.kind != "space"]
        self.before = [t for t in tokens if t.at + len(t.text) <= at]
        self.after = tokens[len(self.before) :]
        self.open = _open(self.before)
        """The brackets that are open, the innermost last."""

    @property
    def inside(self) -> str:
        """The innermost open bracket, empty where there is none."""
        return self.open[-1].text if self.open else ""

    @property
    def opener(self) -> str:
        """The token before the innermost open bracket, empty where there is none."""
        place = next((i for i, t in enumerate(self.before) if self.open and t is self.open[-1]), 0)
        return self.before[place - 1].text if place else ""

    @property
    def within(self) -> str:
        """What stands between the innermost open bracket and the next that closes anything or opens an atom."""
        start = self.open[-1].at + 1
        return re.split(r"[\])}({]", self.text[start:], maxsplit=1)[0]

    @property
    def shown(self) -> str:
        """The next token, to be told."""
        shown = self.next()
        return f"`{shown if len(shown) <= 40 else shown[:40] + '…'}`"

    def next(self, i: int = 0) -> str:
        """The text of a coming token, empty beyond the end."""
        return self.after[i].text if i < len(self.after) else ""

    def kind(self, i: int = 0) -> str:
        """The kind of a coming token, empty beyond the end."""
        return self.after[i].kind if i < len(self.after) else ""

    def last(self, i: int = 1) -> str:
        """The text of a token before, empty where there is none."""
        return self.before[-i].text if i <= len(self.before) else ""

    @property
    def complete(self) -> bool:
        """Whether a part of the formula ends here."""
        return self.last() in ("}", ")", *CONSTANTS) or self.last() in self.names.known

    def unclosed(self) -> str:
        """What is said of the innermost open bracket."""
        begun = " ".join(self.text[self.open[-1].at :].split())
        shown = begun if len(begun) <= 20 else f"{begun[:20]}…"
        return f"`{shown}` is not closed by `{CLOSING[self.inside]}`"


def first_unknown(text: str, names: Names) -> int | None:
    """Where the first word outside of braces stands that is no operator and no name; None where all are."""
    stack: list[str] = []
    before = ""
    for token in _tokens(text):
        if token.kind == "space":
            continue
        if token.kind == "mark" and token.text in CLOSING:
            stack.append("call" if token.text == "(" and before in names.known else token.text)
        elif token.kind == "mark" and stack and token.text in CLOSING.values():
            stack.pop()
        elif (
            token.kind == "word"
            and before not in ("*", *RELATED)
            and (not stack or stack[-1] == "(")
            and token.text not in {*names.known, *WORDS}
        ):
            return token.at
        before = token.text
    return None


def _tokens(text: str) -> Iterator[Token]:
    for match in _TOKEN.finditer(text):
        yield Token(str(match.lastgroup), match[0], match.start())


def _open(tokens: list[Token]) -> list[Token]:
    stack: list[Token] = []
    for token in tokens:
        if token.kind == "mark" and token.text in CLOSING:
            stack.append(token)
        elif token.kind == "mark" and stack and token.text == CLOSING[stack[-1].text]:
            stack.pop()
    return stack
