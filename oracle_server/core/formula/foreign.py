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
    "$": "*",
}
"""What to write for a sign."""
_AHEAD = "a formula is about what has happened, and is judged at every step; "
_LEAVE_OUT = f"{_AHEAD}leave it out, or write `historically` for now and ever before"
_RESPONSE = f"{_AHEAD}that an effect comes within 100 steps is `not (not {{effect}} since[100:] {{cause}})`"
WORDS = {
    **dict.fromkeys(("always", "globally", "G", "AG", "alw", "[]"), _LEAVE_OUT),
    **dict.fromkeys(("eventually", "finally", "F", "AF", "ev", "<>", "~>", "|->", "leads_to", "leadsto"), _RESPONSE),
    **dict.fromkeys(
        ("EF", "EG", "EX", "AU", "EU"), "a formula is about the one run that is there, and not about several"
    ),
    **dict.fromkeys(
        ("until", "U", "W", "R", "unless", "release"),
        f"{_AHEAD}write it with `since`, as in `not {{stop}} since {{start}}`",
    ),
    **dict.fromkeys(("next", "X", "AX"), f"{_AHEAD}the step before is `pre`"),
    **dict.fromkeys(("prev", "previous", "yesterday", "last"), "write `pre` for the step before"),
    **dict.fromkeys(
        ("rise", "rises", "rising", "changed", "start"), "write `{a} and not pre {a}` for where it begins to hold"
    ),
    **dict.fromkeys(("fall", "falls", "falling", "end"), "write `not {a} and pre {a}` for where it ends"),
    "for": "that something has lasted is `lasting[5s] {a}`, with `time: seconds`",
    "within": "a time stands in brackets, as in `once[:2s] {…}` with `time: seconds`",
    **dict.fromkeys(
        ("before", "previously", "past", "ever", "O"), "write `once {…}` for what held at some step until now"
    ),
    **dict.fromkeys(("if", "when", "whenever", "then"), "write `{…} -> {…}`"),
    "iff": "write it out, as in `({a} -> {b}) and ({b} -> {a})`",
    "xor": "write it out, as in `({a} or {b}) and not ({a} and {b})`",
    "never": "write `not`, which is asked at every step",
    **dict.fromkeys(("AND", "OR", "NOT", "IMPLIES", "ONCE", "HISTORICALLY", "SINCE", "FORALL", "EXISTS", "PRE"), ""),
    **dict.fromkeys(("all", "for_all"), "write `forall[x].`"),
    **dict.fromkeys(("<->", "<=>"), "write `({a} -> {b}) and ({b} -> {a})`"),
    "~": "write `not`",
    "&": "write `and`",
    "|": "write `or`",
    "?": "write `({a} -> {b}) and (not {a} -> {c})`",
    **dict.fromkeys(("True", "False", "TRUE", "FALSE"), ""),
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
