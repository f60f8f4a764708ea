"""Reads a file of HPL: properties behind each other, each with its metadata."""

from __future__ import annotations

from fractions import Fraction

from oracle_server.specfiles.hpl.predicates import read_predicate
from oracle_server.specfiles.hpl.scan import Scanner
from oracle_server.specfiles.hpl.tree import Event, Events, HplError, Property

MOST_PROPERTIES = 1_000
PAIRS = ("causes", "forbids", "requires")
_UNITS = {"s": 10**9, "ms": 10**6}
_SCOPE = "a property begins with its scope: `globally:`, `after /a:`, `after /a until /b:` or `until /b:`"
_VERB = "a pattern is `no /a`, `some /a`, or `/a causes /b`, `/a requires /b`, `/a forbids /b`"


def read_properties(text: str, file: str) -> tuple[Property, ...]:
    """The properties of a text. Raises `HplError` with line and column."""
    scanner = Scanner(text, file)
    found: list[Property] = []
    while not scanner.over:
        found.append(_property(scanner))
        if len(found) > MOST_PROPERTIES:
            raise HplError(f"{file}: more than {MOST_PROPERTIES:,} properties: put them in several files")
    if not found:
        raise HplError(f"{file}: no property in it: {_SCOPE}")
    return tuple(found)


def _property(scanner: Scanner) -> Property:
    known = _metadata(scanner)
    at = scanner.at
    opens, closes = _scope(scanner)
    if not scanner.sign(":"):
        scanner.refuse("a scope ends with `:`")
    verb = scanner.word("no", "some")
    trigger: Events = ()
    behaviour = _events(scanner)
    if verb is None:
        verb = scanner.word(*PAIRS) or scanner.refuse(_VERB)
        other = _events(scanner)
        behaviour, trigger = (behaviour, other) if verb == "requires" else (other, behaviour)
    within = _within(scanner) if scanner.word("within") else None
    text = " ".join(scanner.text[at : scanner.end].split())
    id_, title, description = (known.get(key, "") for key in ("id", "title", "description"))
    return Property(verb, behaviour, trigger, opens, closes, within, id_, title, description, text, at)


def _metadata(scanner: Scanner) -> dict[str, str]:
    found: dict[str, str] = {}
    while scanner.sign("#"):
        key = scanner.name() or ""
        scanner.sign(":")
        if key == "id":
            value = scanner.name() or scanner.refuse("behind `# id:` stands a name, as `p1`")
        else:
            read = scanner.string()
            value = read if read is not None else scanner.refuse(f"behind `# {key}:` stands a text in double quotes")
        found[key] = value
    return found


def _scope(scanner: Scanner) -> tuple[Events, Events]:
    if scanner.word("globally"):
        return (), ()
    if scanner.word("after"):
        opens = _events(scanner)
        return opens, _events(scanner) if scanner.word("until") else ()
    if not scanner.word("until"):
        scanner.refuse(_SCOPE)
    return (), _events(scanner)


def _events(scanner: Scanner) -> Events:
    if not scanner.sign("("):
        return (_event(scanner),)
    found = [_event(scanner)]
    while scanner.word("or"):
        found.append(_event(scanner))
    if not scanner.sign(")"):
        scanner.refuse("`or` or `)` is expected behind one of several events")
    return tuple(found)


def _event(scanner: Scanner) -> Event:
    at = scanner.at
    name = scanner.topic() or scanner.refuse("a topic is expected, as `/cmd_vel`")
    topic = name if name[0] in "/~" else f"/{name}"
    alias = ""
    if scanner.word("as"):
        alias = scanner.name() or scanner.refuse("behind `as` stands a name for the message")
    predicate = read_predicate(scanner) if scanner.text.startswith("{", scanner.at) else None
    return Event(topic, alias, predicate, at)


def _within(scanner: Scanner) -> int:
    at = scanner.at
    number = scanner.number() or scanner.refuse("behind `within` stands a time, as `100 ms` or `2 s`")
    unit = scanner.word(*_UNITS) or scanner.refuse("a time is in `s` or `ms`")
    few = len(number) <= 30 and 1e-9 <= float(number) <= 1e8
    exact = Fraction(number) * _UNITS[unit] if few else Fraction(1, 2)
    if exact.denominator != 1:
        scanner.refuse("a time is longer than 0, at most 100,000,000, and in whole nanoseconds", at)
    return int(exact)
