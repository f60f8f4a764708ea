"""What code elsewhere may change, as a statement that can't be read gives it away, and what its variables then share.

Given away is all that is not only looked into: what a function is called with that is not known to look only, what a
method is called on, and what a function of the module has that is itself given away.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable
from dataclasses import dataclass, field

from oracle_server.specfiles.rosmonitoring.expressions import evaluate
from oracle_server.specfiles.rosmonitoring.scope import (
    MODULES,
    MUTATORS,
    READ,
    SHARING,
    acts,
    bound,
    called,
    handed,
    mentioned,
    reads_only,
    root,
)
from oracle_server.specfiles.rosmonitoring.state import Module, State
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Field,
    Imported,
    Items,
    Message,
    Predicates,
    Raises,
    Ref,
    Table,
    Term,
    Unread,
    UntranslatableError,
    Value,
    inside,
    leaves,
    shared,
)

Refs = frozenset[Ref]
_NOTHING: Refs = frozenset()
_SINGLE = ("action", "service", "time", "topic")
"""Keys of a message under which there is no list or dict."""


def given(statement: ast.stmt, state: State, machine: Module) -> tuple[Refs, dict[str, Refs]]:
    """What a statement gives to code that may change it, and what the variables that it binds may share."""
    found = _Given(state, machine, dict.fromkeys(bound([statement]), _NOTHING))
    while True:  # a loop's variables may have what comes later in it
        before = dict(found.own)
        found.statement(statement)
        if found.own == before:
            return found.lost, found.own


def found_at(name: str, state: State, machine: Module) -> Value | None:
    """What a name stands for, None where that is not known."""
    try:
        found = machine.find(name, state)
    except UntranslatableError:
        found = machine.constants.get(name)
    return Predicates() if found is None and name == "predicates" else found


@dataclass(slots=True)
class _Given:
    """Follows one statement; `own` is what the variables share that it binds."""

    state: State
    machine: Module
    own: dict[str, Refs]
    lost: Refs = field(default=_NOTHING)
    read: dict[ast.expr, Value | None] = field(default_factory=dict)

    def statement(self, node: ast.AST) -> None:  # noqa: C901 -- a case a kind of statement
        """Add what a statement, or a part of one, gives away."""
        match node:
            case ast.expr():
                self._value(node)
            case ast.Assign(targets, value):
                self._bind(targets, self._value(value))
            case ast.AnnAssign(target, _, ast.expr() as value):
                self._bind([target], self._value(value))
            case ast.AugAssign(target, _, value):
                self.lost |= self._value(target)
                self._bind([target], self._value(value))
            case ast.For(target, over, body, orelse):
                self._bind([target], self._inside(over))
                for inner in (*body, *orelse):
                    self.statement(inner)
            case ast.withitem(value, target):
                refs = self._value(value)
                self.lost |= refs
                self._bind([target] if target else [], refs)
            case ast.Match(subject, cases):
                refs = self._value(subject)
                self.own |= {name: self.own.get(name, _NOTHING) | refs for name in bound(cases)}
                for case in cases:
                    self.statement(case)
            case _:
                for child in ast.iter_child_nodes(node):
                    self.statement(child)

    def _bind(self, targets: Iterable[ast.expr], refs: Refs) -> None:
        names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
        self.own |= {name: self.own.get(name, _NOTHING) | refs for name in names}

    def _value(self, node: ast.expr) -> Refs:  # noqa: PLR0911 -- a case a kind of expression
        """What the value of an expression may share; what it gives away is added to `lost`."""
        if isinstance(node, ast.Name):
            return self._named(node.id)
        known = self._known(node)
        if known is not None:
            return frozenset(shared(known))
        match node:
            case ast.Subscript(base, index):
                self._value(index)
                return self._item(base, index)
            case ast.Call():
                return self._call(node)
            case ast.NamedExpr(target, value):
                refs = self._value(value)
                self._bind([target], refs)
                return refs
            case ast.Lambda():
                return _NOTHING.union(*map(self._named, mentioned(node)))
            case ast.ListComp(element, loops) | ast.SetComp(element, loops) | ast.GeneratorExp(element, loops):
                return self._comprehension([element], loops)
            case ast.DictComp(key, value, loops):
                return self._comprehension([key, value], loops)
        refs = _NOTHING.union(*(self._value(n) for n in ast.iter_child_nodes(node) if isinstance(n, ast.expr)))
        return _NOTHING if isinstance(node, ast.Compare | ast.JoinedStr) else refs

    def _comprehension(self, elements: list[ast.expr], loops: list[ast.comprehension]) -> Refs:
        for loop in loops:
            self._bind([loop.target], self._inside(loop.iter))
            for test in loop.ifs:
                self._value(test)
        return _NOTHING.union(*map(self._value, elements))

    def _known(self, node: ast.expr) -> Value | None:
        """What an expression was worth before anything was given away, None where it can't be read."""
        if node not in self.read:  # once: each time it would make other lists
            self.read[node] = None if mentioned(node) & self.own.keys() else self._evaluated(node)
        return self.read[node]

    def _evaluated(self, node: ast.expr) -> Value | None:
        before = self.state.copy()
        before.lost = frozenset()
        try:
            return evaluate(node, before, self.machine)
        except UntranslatableError:
            return None
        finally:
            self.state.lost |= before.lost

    def _named(self, name: str) -> Refs:
        refs = self.own.get(name, _NOTHING) | frozenset(shared(found_at(name, self.state, self.machine)))
        return refs | self._reached(called(name, self.machine.scope.definitions))

    def _reached(self, nodes: Iterable[ast.AST]) -> Refs:
        """What functions may change when they are called."""
        known = self.machine.scope.definitions
        nodes = list(nodes)
        if not any(acts(node, known) for node in nodes):
            return _NOTHING
        names = {name.id for node in nodes for name in handed(node, known)}
        words = set[str]().union(*map(mentioned, nodes))
        values = [v for name in names for v in self._everywhere(name)]
        deep = [v for name in words for v in self._everywhere(name)]
        return frozenset(ref for v in values for ref in shared(v)) | frozenset(
            ref for v in deep if not isinstance(v, Predicates) for ref in inside(v)
        )

    def _everywhere(self, name: str) -> list[Value]:
        """What a name stands for here, and in the module."""
        found = (found_at(name, self.state, self.machine), self.machine.constants.get(name))
        return [value for value in found if value is not None]

    def _inside(self, node: ast.expr) -> Refs:
        """What may change in what is found by looking into an expression's value."""
        known = self._named_value(node) if isinstance(node, ast.Name) else self._known(node)
        if known is None:
            return self._value(node)
        refs = frozenset(ref for leaf in leaves(known) if not isinstance(leaf, Predicates) for ref in inside(leaf))
        if any(isinstance(leaf, Predicates) for leaf in leaves(known)):
            refs |= frozenset(ref for value in self.state.predicates.values() for ref in shared(value))
        return refs

    def _named_value(self, node: ast.Name) -> Value | None:
        return None if node.id in self.own else found_at(node.id, self.state, self.machine)

    def _item(self, base: ast.expr, index: ast.expr) -> Refs:
        known = self._named_value(base) if isinstance(base, ast.Name) else self._known(base)
        match known, index:
            case Message(), ast.Constant(str() as key):
                return _NOTHING if key in _SINGLE else frozenset({Field((key,))})
        return self._inside(base)

    def _call(self, call: ast.Call) -> Refs:
        arguments = [*call.args, *(k.value for k in call.keywords)]
        refs = _NOTHING.union(*map(self._value, arguments))
        known = self.machine.scope.definitions
        if reads_only(call, known) and self._is_theirs(root(call.func)):
            return refs if root(call.func) in SHARING and "deepcopy" not in mentioned(call.func) else _NOTHING
        match call.func:
            case ast.Attribute(base, method) if not called(method, known):
                if self._is_data(base) and method not in MUTATORS and not method.startswith("_"):
                    within = self._item(base, call.args[0]) if method == "get" and call.args else self._inside(base)
                    return within | refs
                if method in READ:
                    self.lost |= refs
                    return self._value(base) | refs
            case ast.Name(name) if (nodes := called(name, known)) and name not in self.own:
                if not any(acts(node, known) for node in nodes):
                    words = set[str]().union(*map(mentioned, nodes))
                    return refs | frozenset(ref for w in words for v in self._everywhere(w) for ref in shared(v))
        method = call.func.attr if isinstance(call.func, ast.Attribute) else ""
        refs |= self._value(call.func) | self._reached(called(method, known))
        self.lost |= refs
        return refs

    def _is_theirs(self, name: str) -> bool:
        """Whether a name is Python's, or that of a module which only looks into what it is given."""
        if name in self.own:
            return False
        found = found_at(name, self.state, self.machine)
        if found is None:
            return True
        return name in MODULES and all(isinstance(leaf, Imported | Unread) for leaf in leaves(found))

    def _is_data(self, node: ast.expr) -> bool:
        """Whether a value is known to be of Python's own types."""
        known = self._named_value(node) if isinstance(node, ast.Name) else self._known(node)
        kinds = Const | Term | Field | Items | Table | Message | Predicates | Raises
        return known is not None and all(isinstance(leaf, kinds) for leaf in leaves(known))
