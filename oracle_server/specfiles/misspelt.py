"""What is wrong with a text that is no YAML, and what to write instead."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

_FORMULA = re.compile(r"""[\s\-{,\w:"']*\b(?P<key>formula|pattern|requirement):[ ]+(?P<text>[^|>\s].*)""")

_EXAMPLES = {
    "formula": "'{a} -> {b}'",
    "pattern": "'after /start: no /error'",
    "requirement": "'when low the robot shall satisfy docking'",
}


class Mark(NamedTuple):
    """A place in a text: line and column, from 0."""

    line: int
    column: int


def misspelt(lines: Sequence[str], reason: str, at: Mark, begun: Mark) -> tuple[str, Mark]:
    """What to say, and where, of a reason of the YAML library, which stopped at one place in what began at another."""
    for found in (_of_quotes, _of_formula, _of_first_character, _of_colon, _of_bracket, _of_indentation):
        told = found(lines, reason, at, begun)
        if told is not None:
            return told
    if "control characters" in reason:
        return "this character can't stand in a text file; take it out", at
    return "this can't be read; a text with `: `, ` #`, brackets or quotes in it stands in quotes, or below a `|`", at


def _of_quotes(lines: Sequence[str], reason: str, at: Mark, begun: Mark) -> tuple[str, Mark] | None:
    if "unexpected end of stream" in reason:
        return f"the quote {_char(lines, begun)} that begins here is not closed", begun
    if "escape character" in reason:
        return "a `\\` in double quotes must be part of an escape such as `\\n`; put the text in single quotes", at
    return None


def _of_formula(lines: Sequence[str], _: str, at: Mark, begun: Mark) -> tuple[str, Mark] | None:
    """A formula that is not in quotes, or has the same quotes inside, is the most common cause."""
    for mark in (at, begun):
        match = _FORMULA.match(_line(lines, mark))
        if match is None:
            continue
        key, text, place = match["key"], match["text"], Mark(mark.line, match.start("text"))
        if text[0] in "\"'":
            other = "single" if text[0] == '"' else "double"
            return f"the {key} stands in {text[0]} and has {text[0]} in it; put it in {other} quotes", place
        if text[0] in "{[!&*@%`" or ": " in text:
            sign = f"a {key} that begins with `{text[0]}`" if text[0] in "{[!&*@%`" else f"a {key} with `: ` in it"
            return f"{sign} must stand in quotes, as {key}: {_EXAMPLES[key]}, or below a `|`", place
    return None


def _of_first_character(lines: Sequence[str], reason: str, at: Mark, _: Mark) -> tuple[str, Mark] | None:
    if "alphabetic or numeric" in reason:
        return f"a text can't begin with `{_line(lines, at)[at.column - 1 : at.column]}`; put it in quotes", at
    return _of_unexpected(lines, reason, at, _char(lines, at))


def _of_unexpected(lines: Sequence[str], reason: str, at: Mark, char: str) -> tuple[str, Mark] | None:
    if char == "\t" or ("\t" in _line(lines, at)[: at.column + 1] and not _line(lines, at)[: at.column].strip()):
        return "there is a tab; YAML is indented by spaces", at
    if "cannot start any token" in reason or "undefined alias" in reason:
        return f"a text can't begin with `{char}`; put it in quotes", at
    if "expected node content" in reason and not char:
        return "the line ends where a value should stand: is a bracket not closed?", at
    if "expected node content" in reason:
        return f"this `{char}` closes nothing, or a value is missing before it", at
    if "comment or line break" in reason:
        return "the text begins in the line after `|` or `>`, and nothing but a comment stands beside it", at
    return None


def _of_colon(lines: Sequence[str], reason: str, at: Mark, begun: Mark) -> tuple[str, Mark] | None:
    if "mapping values" in reason:
        above = at.line - 1
        while above > 0 and not lines[above].strip():
            above -= 1
        told = _of_no_key(_line(lines, Mark(above, 0)), above) if not _line(lines, at)[: at.column].count(":") else None
        if told is not None:
            return told
        if ": " in _line(lines, at)[: at.column] or _line(lines, at)[: at.column].count(":"):
            return "a second `: ` in one line; put a text with ': ' in it in quotes, or below a '|'", at
        return "this key is indented deeper than the one above, which has a value already; indent both alike", at
    if "expected ':'" in reason:
        told = _of_no_key(_line(lines, begun), begun.line)
        if told is not None:
            return told
        return "this line is neither `key: value` nor `- item`; is a `:` missing?", begun
    return None


def _of_no_key(line: str, number: int) -> tuple[str, Mark] | None:
    """What keeps a line from being a key with its value."""
    if re.match(r"\s*-\w+:(\s|$)", line):
        return "a space is missing after the `-`", Mark(number, line.index("-"))
    if re.match(r"\s*(- +)?\w+:\S", line):
        return "a space is missing after the `:`", Mark(number, line.index(":"))
    match = re.match(r"\s*(?:- +)?(\w+)\s*=\s*(.*)", line)
    if match:
        return f"a key is followed by `: `: write `{match[1]}: {match[2]}`", Mark(number, match.start(1))
    return None


def _of_bracket(lines: Sequence[str], reason: str, at: Mark, begun: Mark) -> tuple[str, Mark] | None:
    closing = re.search(r"',' or '(.)'", reason)
    if closing is None:
        return None
    if at.line == begun.line:
        return (
            f"a `,` or `{closing[1]}` is missing before this; a text with brackets, `,` or `: ` in it stands in quotes",
            at,
        )
    return f"the `{_char(lines, begun)}` that begins here is not closed by `{closing[1]}`", begun


def _of_indentation(lines: Sequence[str], reason: str, at: Mark, _: Mark) -> tuple[str, Mark] | None:
    if "expected key" not in reason and "'-' indicator" not in reason:
        return None
    if _line(lines, at)[: at.column].strip():
        return "nothing can follow here; put the whole text in quotes", at
    if _line(lines, at)[at.column :].startswith("- "):
        return "this `- ` does not stand below another one: items of one list begin in the same column", at
    return "this line is indented like none above it: keys that belong together begin in the same column", at


def _line(lines: Sequence[str], mark: Mark) -> str:
    return lines[mark.line] if mark.line < len(lines) else ""


def _char(lines: Sequence[str], mark: Mark) -> str:
    return _line(lines, mark)[mark.column : mark.column + 1]
