"""Signs, words and units that people bring from other languages, and what to write for them here."""
# ruff: noqa: RUF001 -- typographic signs are what it is about

from __future__ import annotations

from oracle_server.core.formula.tree import Time

SYMBOLS = {
    **dict.fromkeys("→⇒⟶⟹⊃", "->"),
    **dict.fromkeys("“”„«»", '"'),
    **dict.fromkeys("‘’‚`", "'"),
    **dict.fromkeys("↔⇔", "(φ -> ψ) and (ψ -> φ)"),
    "∀": "forall[x].",
    "∃": "exists[x].",
    "¬": "not",
    "∧": "and",
    "∨": "or",
    **dict.fromkeys("≤⩽", "<="),
    **dict.fromkeys("≥⩾", ">="),
    "≠": "!=",
    "■": "historically",
    **dict.fromkeys("◆⧫⬥", "once"),
    "⊤": "true",
    "⊥": "false",
    **dict.fromkeys("–—−", "-"),
    "\u00a0": " ",
    ";": ",",
    "$": "*",
}
"""What to write for a sign."""
_LEAVE_OUT = (
    "a formula is judged at every step; leave it out, or write `historically` for now and ever before, and "
    "`{cause} -> always[…] {effect}` for what lasts from a cause on"
)
_RESPONSE = "write `{cause} -> eventually[…] {effect}` for an effect that comes within that bound"
WORDS = {
    **dict.fromkeys(("globally", "G", "AG", "alw", "[]", *"□◻⬜"), _LEAVE_OUT),
    **dict.fromkeys(("finally", "F", "AF", "ev", "<>", "~>", "|->", "leads_to", "leadsto", *"◇◊⋄⬦"), _RESPONSE),
    **dict.fromkeys(
        ("EF", "EG", "EX", "AU", "EU"), "a formula is about the one run that is there, and not about several"
    ),
    **dict.fromkeys(("U", "𝒰", "𝓤"), "write `{start} -> {held} until[…] {stop}`"),
    **dict.fromkeys(
        ("W", "R", "unless", "release"),
        "write it with `until`, as in `{start} -> {held} until {stop}`, or with `since`, as in "
        "`not {stop} since {start}`",
    ),
    **dict.fromkeys(("X", "AX", *"○◯"), "write `next` for the step after, and `pre` for the one before"),
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
    **dict.fromkeys(("xor", "⊕"), "write it out, as in `({a} or {b}) and not ({a} and {b})`"),
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
"""What to write for a word, `[…]` for its bound; empty where it is the same word in small letters."""
_BOUNDS: dict[Time, str] = {"steps": "[:100]", "seconds": "[:60s]"}
UNITS = {
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("msec", "msecs", "millis", "milliseconds"), "ms"),
    **dict.fromkeys(("m", "mins", "minute", "minutes"), "min"),
    **dict.fromkeys(("usec", "microseconds", "µs"), "us"),
    **dict.fromkeys(("nsec", "nanoseconds"), "ns"),
    **dict.fromkeys(("hr", "hour", "hours"), "h"),
}
"""What to write for a unit of time."""


def instead(word: str, time: Time, bound: str) -> str:
    """What to write for a word; empty for one that is not known. An empty bound stands for any that `time` counts."""
    if word not in WORDS:
        return ""
    return WORDS[word].replace("[…]", bound or _BOUNDS[time]) or f"write `{word.lower()}`"
