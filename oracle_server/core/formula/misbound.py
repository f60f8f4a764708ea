"""What is wrong with a bound, or with the variables of a quantifier, and what to write instead."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import NamedTuple

from oracle_server.core.formula.around import AHEAD, BOUNDED, OPERATORS, QUANTIFIERS, Around
from oracle_server.core.formula.foreign import UNITS

_SIZES = {"ns": 1, "us": 10**3, "ms": 10**6, "": 10**9, "s": 10**9, "min": 60 * 10**9, "h": 3600 * 10**9}
_BETWEEN = re.compile(r"\s*(?::|,|;|\.\.+|\bto\b)\s*")
_END = re.compile(r"(?P<order>[<>]?)=?\s*(?P<sign>[-+]?)\s*(?P<number>\d+(?:\.\d+)?)\s*(?P<unit>[^\W\d]*)")
_OPEN = ("", "inf", "infinity", "infty", "oo", "∞", "+inf", "-inf", "*", "end")
_EXAMPLES = "write `[:5]`, `[5:]` or `[2:5]`"
_NAMES = re.compile(r"[^\W\d]\w*(?:\s*,\s*[^\W\d]\w*)*")


class _End(NamedTuple):
    """One end of a bound as it is written here, or None where it is open."""

    text: str | None
    size: Fraction
    order: str = ""
    signed: bool = False


def of_bound(found: Around) -> str:
    """Of a text in the square brackets behind an operator that has a bound; empty for any other place."""
    if found.inside != "[" or found.opener in QUANTIFIERS:
        return ""
    within = found.within.strip()
    if found.opener == "lasting":
        return of_lasting(within)
    if not found.text[found.open[-1].at + 1 + len(found.within) :].startswith("]"):
        ends = _ends(within)
        bound = _bound(ends) if ends and not isinstance(ends, str) else None
        begun = within if len(within) <= 20 else f"{within[:20]}…"
        return f"the bound that begins with `[{begun}` is not closed: write `{bound or '[2:5]'}`"
    wrong = f"the bound [{within}]" if len(within) <= 40 else "the bound"
    return f"{wrong} can't be read: {mended(within, ahead=found.opener in AHEAD)}"


def of_lasting(within: str) -> str:
    """Of `lasting` and what stands behind it, where that is not how long something has lasted."""
    ends = _ends(within)
    told = [end.text for end in ends if end.text] if not isinstance(ends, str) else []
    return f"`lasting` is followed by how long, in square brackets: write `lasting[{told[0] if told else 5}] {{…}}`"


def behind(found: Around) -> str:
    """The bound behind a word of another language, as what is awaited has it; empty where it has none of its clock."""
    if found.next(1) != "[":
        return ""
    ends = _ends(found.text[found.after[1].at + 1 :].partition("]")[0])
    if isinstance(ends, str) or not ends or any(end.signed or end.order == ">" for end in ends):
        return ""
    counted = all(end.text is None or end.text.isdecimal() for end in ends)
    bound = _bound(ends) if any(end.text for end in ends) else None
    return bound or "" if counted or found.time == "seconds" else ""


def of_displaced(found: Around) -> str:
    """Of a bound that does not stand in square brackets; empty for anything else."""
    if found.last() in BOUNDED and found.kind() == "number":
        unit = found.next(1) if found.kind(1) == "word" and _unit(found.next(1)) else ""
        return (
            f"a bound stands in square brackets: write `{found.last()}[:{found.next().lstrip('-')}{_unit(unit) or ''}]`"
        )
    begins = found.kind() == "number" or found.next() in (":", "<", "<=")
    if found.inside not in ("(", "{") or found.opener not in BOUNDED or found.last() != found.inside or not begins:
        return ""
    ends = _ends(found.within)
    bound = _bound(ends) if ends and not isinstance(ends, str) else None
    return f"a bound stands in square brackets: write `{found.opener}{bound or '[2:5]'}`"


def unbounded(word: str, within: str) -> str:
    """Of a bound behind an operator that has none."""
    if word == "next":
        return "`next` has no bound, and means one step after: write `next {…}`, or `eventually[:5] {…}`"
    if word != "pre":
        return f"`{word}` has no bound: `once[1:2] {{…}}` has one"
    ends = re.fullmatch(r"\s*(\d+)\s*(?:[:,]\s*(\d+))?\s*", within)
    if ends is None or ends[1] == "1" == (ends[2] or ends[1]):
        return "`pre` has no bound, and means one step before: write `pre {…}`"
    first, last = ends[1], ends[2] or ends[1]
    return f"`pre` has no bound, and means one step before: write `once[{first}:{last}] {{…}}`"


def mended(within: str, *, ahead: bool = False) -> str:  # noqa: PLR0911 -- a case a mistake
    """What to write for a bound that can't be read; `ahead`: of what is awaited."""
    ends = _ends(within)
    if isinstance(ends, str):
        return f"there is no unit '{ends}'; there are ns, us, ms, s, min and h"
    if not ends or len(ends) > 2:
        return _EXAMPLES
    if not any(end.text for end in ends):
        return f"leave the brackets out for whatever was, or {_EXAMPLES}"
    if any(end.signed for end in ends):
        way = "on" if ahead else "back"
        if len(ends) == 2 and ends[0].text and ends[1].text and ends[1].size and not ends[1].signed:
            return f"it counts {way} from now, without a sign, and has one side: {_both_ways(ends)}"
        return f"it counts {way} from now, without a sign: write `{_bound(ends)}`"
    if len(ends) == 1 and not ends[0].order and ends[0].text is not None:
        text = ends[0].text
        if ahead:
            return f"write `[:{text}]` for within {text}, or `[{text}:]` for what comes after {text}"
        return f"write `[:{text}]` for up to {text} ago, or `[{text}:]` for at least so long ago"
    spaced = "".join(within.split()) == f"{_bound(ends)}"[1:-1]
    return f"write `{_bound(ends)}`" + (", without spaces" if spaced else "")


def _both_ways(ends: list[_End]) -> str:
    """What to write for a bound that begins before now and ends after it."""
    before, after = (f"[:{end.text}]" for end in ends)
    return f"what came before is `once{before} {{…}}`, and what comes after `{{cause}} -> eventually{after} {{…}}`"


def of_variables(found: Around) -> str:
    """Of the variables of a quantifier; empty for any other place."""
    if found.last() in QUANTIFIERS:
        match = _NAMES.match(found.text[found.at :].lstrip("([ "))
        listed = [name.strip() for name in match[0].split(",")] if match else []
        names = ", ".join(name for name in listed if name not in OPERATORS) or "x"
        return f"variables stand in brackets, with a `.` behind: write `{found.last()}[{names}]. {{…}}`"
    words = [t.text for t in found.before[-8:]]
    word = next((word for word in QUANTIFIERS if word in words), None)
    if word and found.last() == "]" and "[" in words:
        names = found.text[: found.before[-1].at].rpartition("[")[2].strip()
        return f"a `.` is missing after `{word}[{names}]`: write `{word}[{names}]. {{…}}`"
    if found.inside == "[":
        return "variables are names with `,` between them: write `forall[x, y].`"
    return ""


def _ends(within: str) -> list[_End] | str:
    """The ends of a bound as people write it; the unit where there is none such, no ends where they can't be read."""
    ends = []
    for part in _BETWEEN.split(within.strip()):
        if part.lower() in _OPEN:
            ends.append(_End(None, Fraction(0)))
            continue
        match = _END.fullmatch(part)
        if match is None:
            return []
        unit = _unit(match["unit"])
        if unit is None:
            return match["unit"]
        size = Fraction(match["number"]) * _SIZES[unit]
        ends.append(_End(match["number"] + unit, size, match["order"], match["sign"] == "-"))
    return ends


def _unit(written: str) -> str | None:
    """A unit as it is written here, None where there is none such."""
    unit = UNITS.get(written.lower(), written)
    return unit if unit in _SIZES else None


def _bound(ends: list[_End]) -> str | None:
    """A bound as it is written here, None where there are too many ends."""
    if len(ends) > 2:
        return None
    if len(ends) == 1:
        text = ends[0].text or ""
        return f"[{text}:]" if ends[0].order == ">" else f"[:{text}]"
    first, last = sorted(ends, key=lambda e: e.size) if all(e.text for e in ends) else ends
    if any(end.signed for end in ends) and not all(end.text for end in ends):
        first, last = last, first
    return f"[{first.text or ''}:{last.text or ''}]"
