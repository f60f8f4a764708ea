"""What is wrong with a formula that can't be read, and what to write instead."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.foreign import SYMBOLS, UNITS, WORDS

_TOKEN = re.compile(
    r"""(?P<space>\s+)
    |(?P<string>"[^"\n]*"|'[^'\n]*')
    |(?P<word>[^\W\d]\w*)
    |(?P<number>-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)
    |(?P<mark><->|<=>|[-=]+>|[<>=!]=|&&|\|\||.)""",
    re.VERBOSE | re.DOTALL,
)
_OPERATORS = ("not", "and", "or", "implies", "pre", "once", "historically", "since", "forall", "exists")
_CLOSING = {"{": "}", "(": ")", "[": "]"}


class _Token:
    """A piece of the text, with its place."""

    def __init__(self, kind: str, text: str, at: int) -> None:
        self.kind, self.text, self.at = kind, text, at


class _Found:
    """The text around the place where the formula can't be read on."""

    def __init__(self, text: str, at: int) -> None:
        self.text, self.at = text, at
        tokens = [t for t in _tokens(text) if t.kind != "space"]
        self.before = [t for t in tokens if t.at + len(t.text) <= at]
        self.after = tokens[len(self.before) :]
        self.open = _open(self.before)
        """The brackets that are open, the innermost last."""

    @property
    def inside(self) -> str:
        """The innermost open bracket, empty where there is none."""
        return self.open[-1].text if self.open else ""

    def next(self, i: int = 0) -> str:
        """The text of a coming token, empty beyond the end."""
        return self.after[i].text if i < len(self.after) else ""

    def last(self, i: int = 1) -> str:
        """The text of a token before, empty where there is none."""
        return self.before[-i].text if i <= len(self.before) else ""

    def unclosed(self) -> str:
        """What is said of the innermost open bracket."""
        begun = " ".join(self.text[self.open[-1].at :].split())
        shown = begun if len(begun) <= 20 else f"{begun[:20]}…"
        return f"`{shown}` is not closed by `{_CLOSING[self.inside]}`"


def misread(text: str, at: int | None) -> FormulaError:
    """The error for a formula that can't be read from the character `at` on, None or the length for its end."""
    if not text.strip():
        return FormulaError("the formula is empty; write what must hold, as in `{speed > 1} -> {enabled}`")
    end = len(text.rstrip())
    found = _Found(text, end if at is None or at < 0 or at >= end else at)
    if found.after:
        message = _reason(found)
    elif found.open:
        message = f"the formula ends too early: {found.unclosed()}"
    else:
        message = f"the formula ends too early: something must follow `{found.last()}`"
    return FormulaError(message, *_place(text, found.at))


def _reason(found: _Found) -> str:
    """Why the formula can't be read on, by the first cause that explains it."""
    causes = (_of_symbol, _of_quote, _of_bound, _of_quantifier, _of_brackets, _of_atom, _of_word, _of_operator)
    for cause in causes:
        message = cause(found)
        if message:
            return message
    if found.inside == "{":
        return f"{_shown(found)} is not expected here: an atom is written as {{key: value}}, or {{key > 3, flag}}"
    return f"{_shown(found)} is not expected here"


def _of_symbol(found: _Found) -> str:
    char = found.next()[:1]
    if char == ";" and found.inside != "{":
        return ""
    return f"'{char}' is no sign of formulas; write `{SYMBOLS[char]}`" if char in SYMBOLS else ""


def _of_quote(found: _Found) -> str:
    char = found.next()[:1]
    if char in "\"'" and len(found.next()) == 1:
        return f"the quote {char} is not closed on its line"
    return ""


def _of_bound(found: _Found) -> str:
    if found.inside != "[" or found.last(_distance_to(found)) in ("forall", "exists", "A", "E"):
        return ""
    start = found.open[-1].at
    end = found.text.find("]", start)
    inside = found.text[start + 1 : end if end >= 0 else len(found.text)]
    wrong = f"the bound [{inside}]" if len(inside) <= 40 and end >= 0 else "the bound"
    unit = re.search(r"(\d+(?:\.\d+)?)\s*([a-zµA-Z]+)", inside[max(0, found.at - start - 20) :])
    if unit and UNITS.get(unit[2].lower(), unit[2]) in ("ns", "us", "ms", "s", "min", "h"):
        return f"{wrong} can't be read: write `{unit[1]}{UNITS.get(unit[2].lower(), unit[2])}`, without spaces"
    if unit:
        return f"{wrong} can't be read: there is no unit '{unit[2]}'; there are ns, us, ms, s, min and h"
    numbers = re.findall(r"\d+(?:\.\d+)?", inside)
    mend = f"write `[{numbers[0]}:{numbers[1]}]`" if len(numbers) == 2 else "write `[:5]`, `[5:]` or `[2:5]`"
    if len(numbers) == 1:
        mend = f"write `[:{numbers[0]}]` for up to {numbers[0]} ago, or `[{numbers[0]}:]` for at least so long ago"
    return f"{wrong} can't be read: {mend}"


def _distance_to(found: _Found) -> int:
    """How far before the end the token stands that comes before the innermost open bracket."""
    return next(i for i, t in enumerate(reversed(found.before), 1) if t is found.open[-1]) + 1


def _of_quantifier(found: _Found) -> str:
    words = [t.text for t in found.before[-8:]]
    for word in ("forall", "exists", "A", "E"):
        if found.last() == word:
            names = ", ".join(re.findall(r"[^\W\d]\w*", found.text[found.at :].split(".")[0])[:3]) or "x"
            return f"variables stand in brackets: write `{word}[{names}].`"
        if word in words and found.last() == "]" and "[" in words:
            return f"a `.` is missing after `{word}[…]`: write `{word}[…]. {{…}}`"
    if found.inside == "[":
        return "variables are names with `,` between them: write `forall[x, y].`"
    return ""


def _of_brackets(found: _Found) -> str:
    mark = found.next()
    if mark in ("}", ")", "]") and found.after[0].kind == "mark":
        if found.inside == "{" and found.last() == "{":
            return "the atom `{}` is empty; write what must hold, as in `{speed > 1}`"
        if not found.open:
            return f"this `{mark}` closes nothing"
        if _CLOSING[found.inside] != mark:
            return found.unclosed()
        return f"something is missing between `{found.last()}` and `{mark}`"
    if found.inside == "{" and mark in ("->", "implies", "{", "since", "once", "historically"):
        return found.unclosed()
    return ""


def _of_atom(found: _Found) -> str:  # noqa: C901, PLR0911, PLR0912 -- a case a mistake
    if found.inside != "{":
        return ""
    mark, before = found.next(), found.last()
    if mark in ("and", "&&", "or", "||"):
        word = {"&&": "and", "||": "or"}.get(mark, mark)
        comma = "; `,` between constraints means `and`" if word == "and" else ""
        return f"`{mark}` stands between atoms, not inside of one: write `{{…}} {word} {{…}}`{comma}"
    if mark in ("not", "!") or before == "not" or (mark == "!=" and before in ("{", ",")):
        return "`not` stands before an atom, not inside of one: write `not {…}`, or `{flag: false}`"
    if before in ("<", "<=", ">", ">="):
        mend = "of two fields declare one signal: `faster: msg.speed > msg.limit`"
        return f"`{before}` compares with a number, and {_shown(found)} is none; {mend}"
    if before == "!=":
        return f"`!=` compares with a text, a number, true or false, and {_shown(found)} is none of these"
    if mark == "(":
        return f"there are no functions in atoms: declare a signal that is computed, as `v: {before}(msg.x)`"
    if mark in (".", "[") and found.before[-1].kind == "word":
        return _of_path(found)
    if found.before[-1].kind == "number":
        return f"`{before}` and {_shown(found)} do not stand side by side: a number is followed by `,` or `}}`"
    if mark in ("+", "-", "*", "/", "%"):
        return f"there is no arithmetic in atoms: declare a signal that is computed, as `x: msg.a {mark} msg.b`"
    if before in ("{", ",") and found.after[0].kind == "number":
        turned = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}.get(found.next(1), found.next(1))
        mend = f"{found.next(2)} {turned} {mark}" if found.next(2).isidentifier() else f"speed > {mark}"
        return f"a constraint begins with the signal: write `{{{mend}}}`"
    if mark in ("=>", "=<"):
        return f"write `{'>=' if mark == '=>' else '<='}`"
    if mark == "in":
        return "there is no `in`: write `{mode: AUTO} or {mode: IDLE}`"
    if found.after[0].kind in ("word", "string", "number") and before not in ("{", ",", ":", "="):
        return f"a `,` or a comparison is missing between `{before}` and {_shown(found)}"
    return ""


def _of_path(found: _Found) -> str:
    """A field of a message where a signal should stand."""
    start = found.before[-1]
    match = re.match(r"[\w.\[\]]+", found.text[start.at :])
    path = match[0] if match else start.text
    name = re.findall(r"[^\W\d]\w*", path)[-1]
    field = path.removeprefix("msg.")
    return f"`{path}` is no name of a signal: declare `{name}: msg.{field}` under `signals`, and write `{name}`"


def _of_word(found: _Found) -> str:
    if found.inside == "{" or found.after[0].kind != "word" or found.next() in _OPERATORS:
        return ""
    word, follows = found.next(), found.next(1)
    if word in WORDS:
        return f"there is no operator `{word}`: {WORDS[word] or f'write `{word.lower()}`'}"
    if follows in ("<", "<=", ">", ">=", "==", "!=", "=", ":"):
        atom = f"{word} {follows} {found.next(2)}".replace(" :", ":")
        return f"`{atom}` stands outside of braces: write `{{{atom}}}`"
    near = difflib.get_close_matches(word.lower(), _OPERATORS, 1, 0.7)
    if near:
        return f"there is no operator `{word}`; did you mean `{near[0]}`?"
    if found.before and found.last() in ("}", ")"):
        return f"`{word}` is not expected here: between two parts stands `and`, `or`, `since` or `->`"
    return f"`{word}` stands outside of braces: a signal is written `{{{word}}}`"


def _of_operator(found: _Found) -> str:  # noqa: PLR0911 -- a case a mistake
    mark = found.next()
    if found.inside != "{" and re.fullmatch(r"[-=]+>", mark) and mark != "->":
        return f"there is no operator `{mark}`: write `->`"
    if mark in ("<->", "<=>"):
        return f"there is no operator `{mark}`: write `({{a}} -> {{b}}) and ({{b}} -> {{a}})`"
    if mark in ("&", "|"):
        return f"write `{'and' if mark == '&' else 'or'}`"
    if mark in ("{", "(", "!", "not", "once", "pre", "historically") and found.last() in ("}", ")"):
        return f"`{mark}` is not expected here: between two parts stands `and`, `or`, `since` or `->`"
    if mark in ("and", "or", "->", "since", "implies", "&&", "||"):
        first = f"after `{found.last()}`" if found.before else "at the beginning"
        return f"something is missing {first}: `{mark}` stands between two parts, as in `{{a}} {mark} {{b}}`"
    if mark == "[" and found.last() in ("pre", "not"):
        return f"`{found.last()}` has no bound: `once[1:2] {{…}}` has one"
    if mark == "[":
        return "a bound stands after `once`, `historically` or `since`, as in `once[:5] {…}`"
    return ""


def _shown(found: _Found) -> str:
    shown = found.next()
    return f"`{shown if len(shown) <= 40 else shown[:40] + '…'}`"


def _tokens(text: str) -> Iterator[_Token]:
    for match in _TOKEN.finditer(text):
        yield _Token(str(match.lastgroup), match[0], match.start())


def _open(tokens: list[_Token]) -> list[_Token]:
    stack: list[_Token] = []
    for token in tokens:
        if token.kind == "mark" and token.text in _CLOSING:
            stack.append(token)
        elif token.kind == "mark" and stack and token.text == _CLOSING[stack[-1].text]:
            stack.pop()
    return stack


def _place(text: str, at: int) -> tuple[int, int]:
    return (text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at))
