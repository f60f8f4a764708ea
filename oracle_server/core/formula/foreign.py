"""Signs, words and units that people bring from other languages, and what to write for them here."""
# ruff: noqa: RUF001 -- typographic signs are what it is about

from __future__ import annotations

SYMBOLS = {
    **dict.fromkeys("→⇒⟶⟹", "->"),
    **dict.fromkeys("“”„«»", '"'),
    **dict.fromkeys("‘’‚`", "'"),
    **dict.fromkeys("↔⇔", "(φ -> ψ) and (ψ -> φ)"),
    "∀": "forall[x].",
    "∃": "exists[x].",
    "¬": "not",
    "∧": "and",
    "∨": "or",
    "≤": "<=",
    "≥": ">=",
    "≠": "!=",
    "□": "historically",
    "◇": "once",
    "–": "-",
    "—": "-",
    "\u00a0": " ",
    ";": ",",
}
"""What to write for a sign."""
_AHEAD = "a formula is about what has happened, and is judged at every step; "
_LEAVE_OUT = f"{_AHEAD}leave it out, or write `historically` for now and ever before"
_RESPONSE = f"{_AHEAD}that an effect comes within 100 steps is `not (not {{effect}} since[100:] {{cause}})`"
WORDS = {
    **dict.fromkeys(("always", "globally", "G"), _LEAVE_OUT),
    **dict.fromkeys(("eventually", "finally", "F"), _RESPONSE),
    **dict.fromkeys(("until", "U", "W", "R"), f"{_AHEAD}write it with `since`, as in `not {{stop}} since {{start}}`"),
    **dict.fromkeys(("next", "X"), f"{_AHEAD}the step before is `pre`"),
    "within": "a time stands in brackets, as in `once[:2s] {…}` with `time: seconds`",
    **dict.fromkeys(("before", "previously", "past"), "write `once {…}` for what held at some step until now"),
    **dict.fromkeys(("if", "when", "whenever", "then"), "write `{…} -> {…}`"),
    **dict.fromkeys(("iff", "xor"), "write it out, as in `({a} -> {b}) and ({b} -> {a})`"),
    **dict.fromkeys(("AND", "OR", "NOT", "IMPLIES", "ONCE", "HISTORICALLY", "SINCE", "FORALL", "EXISTS", "PRE"), ""),
    **dict.fromkeys(("all", "for_all"), "write `forall[x].`"),
    **dict.fromkeys(("true", "True"), "it is no formula; leave it out, or write an atom such as `{flag: true}`"),
    **dict.fromkeys(("false", "False"), "it is no formula; write an atom such as `{flag: false}`"),
}
"""What to write for a word; empty where it is the same word in small letters."""
UNITS = {
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("msec", "msecs", "millis", "milliseconds"), "ms"),
    **dict.fromkeys(("m", "mins", "minute", "minutes"), "min"),
    **dict.fromkeys(("usec", "microseconds", "µs"), "us"),
    **dict.fromkeys(("nsec", "nanoseconds"), "ns"),
    **dict.fromkeys(("hr", "hour", "hours"), "h"),
}
"""What to write for a unit of time."""
