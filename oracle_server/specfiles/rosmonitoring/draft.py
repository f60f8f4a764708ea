"""The signals and properties of an imported spec, before they are written: of one module, or of several together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from oracle_server.core.formula.tree import Atom, Constraint, Formula, atoms
from oracle_server.core.kinds import RESERVED
from oracle_server.core.typed import TypedMessage
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.model import ros_type
from oracle_server.specfiles.rosmonitoring.cel import FAILS
from oracle_server.specfiles.rosmonitoring.config import Config, Interface
from oracle_server.specfiles.rosmonitoring.formulas import FutureError, changed
from oracle_server.specfiles.rosmonitoring.module import PropertyModule
from oracle_server.specfiles.rosmonitoring.streams import Stream
from oracle_server.specfiles.rosmonitoring.translate import Signal, Translation, translate

TODO = "todo"
"""The signal of formulas that can't be read: it fails at every event."""


@dataclass(slots=True)
class Draft:
    """What the modules became: a translation each, None where its oracle still judges, and all signals by name."""

    properties: list[tuple[PropertyModule, Translation | None]] = field(default_factory=list)
    signals: dict[str, Signal] = field(default_factory=dict)
    oracles: bool = True
    """Whether any monitor has an oracle, which judges where no module does."""

    @property
    def unread(self) -> list[str]:
        """The predicates that could not be read."""
        return sorted(name for name, signal in self.signals.items() if signal.unread and name != TODO)

    @property
    def failing(self) -> list[str]:
        """The streams at whose messages the module fails whatever they have, each once."""
        found = [stream for signal in self.signals.values() for stream, cel in signal.cel.items() if cel == FAILS]
        return list(dict.fromkeys(f"{stream.name} {stream.kind}" for stream in found))

    @property
    def unjudged(self) -> list[str]:
        """The properties whose formula could not be read, or that nobody has judged."""
        if not self.properties and not self.oracles:
            return [TODO]
        return [module.name for module, found in self.properties if found is not None and found.formula is None]

    @property
    def judges(self) -> bool:
        """Whether any property can say anything before what is left is written; of none its oracle still judges."""
        if not self.properties:
            return self.oracles
        return any(found is None or self._says(found) for _, found in self.properties)

    def _says(self, found: Translation) -> bool:
        if found.formula is None:
            return False
        keys = {constraint.key for atom in atoms(found.formula) for constraint in atom.constraints}
        read = [self.signals[key] for key in keys if key in self.signals]
        return not read or not all(signal.unread for signal in read)


def streams_of(interface: Interface, types: Types | None = None) -> list[Stream]:
    """The streams of an interface, as their messages name them; with `types`, with what is known of these."""
    name = interface.name.removeprefix("/") if interface.bare else interface.name
    if interface.kind == "action":
        return [Stream("action", name, kind) for kind in interface.observed]
    kinds = ("topic",) if interface.kind == "topic" else ("request", "response")
    return [Stream(interface.kind, name, kind, _message(interface.type, kind, types)) for kind in kinds]


def _message(type_: str, kind: str, types: Types | None) -> TypedMessage | None:
    if types is None or not type_:
        return None
    half = "" if kind == "topic" else f"_{kind.capitalize()}"
    found = types.message(ros_type(type_, "msg" if kind == "topic" else "srv") + half)
    return found if isinstance(found, TypedMessage) else None


def make_draft(config: Config, modules: Sequence[PropertyModule], types: Types | None = None) -> Draft:
    """Translate the modules for all streams of a configuration, by the types of their messages where known."""
    streams = [stream for interface in config.interfaces for stream in streams_of(interface, types)]
    draft = Draft(oracles=bool(config.oracles))
    for module in modules:
        try:
            found = translate(module, streams)
        except FutureError:
            reason = "its formula is about what comes, and no monitor has an `oracle` that judges it"
            draft.properties.append((module, None if config.oracles else Translation(module, reason=reason)))
            continue
        draft.properties.append((module, found))
        names = {name: _free(name, module, signal, draft) for name, signal in found.signals.items()}
        if found.formula is not None:
            found.formula = changed(found.formula, _Renamed(names))
        draft.signals |= {names[name]: signal for name, signal in found.signals.items()}
    if draft.unjudged:
        draft.signals[TODO] = Signal(unread=dict.fromkeys(streams, ""))
    return draft


def _free(name: str, module: PropertyModule, signal: Signal, draft: Draft) -> str:
    """The name of a signal: the predicate's, unless it is reserved, or another module has made another one of it."""
    for free in (name, f"{name}_", f"{module.name.replace('-', '_').replace('.', '_')}_{name}"):
        if free not in RESERVED and free != TODO and draft.signals.get(free, signal) == signal:
            return free
    return f"{name}_{len(draft.signals)}"


@dataclass(frozen=True, slots=True)
class _Renamed:
    names: dict[str, str]

    def __call__(self, atom: Atom) -> Formula:
        return Atom(tuple(Constraint(self.names[c.key], c.op, c.value) for c in atom.constraints), atom.at)
