"""Follows a function's statements, every way at once: what it assigns to predicates, and what it returns."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from oracle_server.specfiles.rosmonitoring.branches import merged
from oracle_server.specfiles.rosmonitoring.calls import function
from oracle_server.specfiles.rosmonitoring.cel import collapsed, truth
from oracle_server.specfiles.rosmonitoring.cel import field as field_text
from oracle_server.specfiles.rosmonitoring.expressions import evaluate
from oracle_server.specfiles.rosmonitoring.functions import (
    can_be_keys,
    check,
    defined,
    parameters,
    set_outside,
    unbound,
)
from oracle_server.specfiles.rosmonitoring.imports import imported
from oracle_server.specfiles.rosmonitoring.left import leave
from oracle_server.specfiles.rosmonitoring.operators import arithmetic, grows
from oracle_server.specfiles.rosmonitoring.scope import LOGS, Scope, root
from oracle_server.specfiles.rosmonitoring.state import State, is_lost, keep, lose
from oracle_server.specfiles.rosmonitoring.streams import Stream
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Field,
    Function,
    Imported,
    Items,
    Leaf,
    Raises,
    Ref,
    Term,
    Thing,
    UnfollowableError,
    Unread,
    UntranslatableError,
    Value,
    choice,
    each,
    leaves,
    same,
    shared,
)

_MAX_STEPS = 4000
_MAX_DEPTH = 16


@dataclass(frozen=True, slots=True)
class End:
    """Where a function ends: what it returns, None where it goes on, and the state then."""

    returned: Value | None
    state: State


@dataclass(slots=True)
class Machine:
    """A module's names and initial predicates, and the stream whose message is followed, None for the module itself.

    `constants` are what its names stand for, functions among them; others stand for what Python has built in, unless
    the module is `opaque`: then they may stand for anything. `flags` are the predicates that are never anything but
    Booleans, `changing` the names that keep something from one message to the next, and `lost` lists and dicts of the
    constants that do.
    """

    constants: Mapping[str, Value] = field(default_factory=dict)
    initial: Mapping[str, Value] = field(default_factory=dict)
    flags: frozenset[str] = frozenset()
    changing: frozenset[str] = frozenset()
    scope: Scope = field(default_factory=Scope)
    lost: set[Ref] = field(default_factory=set)
    stream: Stream | None = None
    opaque: bool = False
    steps: int = 0
    depth: int = 0

    def find(self, name: str, state: State) -> Value | None:
        """What a name stands for, None where the module does not bind it.

        Raises `UntranslatableError` where that is not known, as of what another message may have bound.
        """
        owner = state.owner(name)
        if owner is None and name in self.changing:
            raise UntranslatableError
        found = self.constants.get(name) if owner is None else owner.variables[name]
        if found is None and self.opaque and name not in ("predicates", "dict"):  # which nobody else calls so
            raise UntranslatableError
        return found

    def call(self, name: str, node: ast.Call, state: State) -> Value:
        """What a function that assigns nothing outside returns. Raises `UntranslatableError`."""
        called = self.find(name, state)
        if not isinstance(called, Function):
            raise UntranslatableError
        if name in self.scope.changers:
            raise UnfollowableError
        try:
            end = self._enter(called, node, state)
        except UnfollowableError:  # what it does to its own variables is not known; it has no others
            raise UntranslatableError from None
        return Const(None) if end.returned is None else end.returned

    def _enter(self, called: Function, node: ast.Call, state: State) -> End:
        if self.depth >= _MAX_DEPTH:
            raise UntranslatableError
        check(called.node)
        arguments = self._arguments(called, node, state)
        if called.cached and not can_be_keys(arguments.values()):
            raise UntranslatableError
        around = state.owner(called.node.name)
        inner = State(unbound(called.node) | arguments, state.predicates, around, lost=state.lost)
        self.depth += 1
        try:
            end = self.follow(called.node.body, inner)
        finally:
            self.depth -= 1
        state.lost |= end.state.lost
        if called.cached and end.returned is not None and any(True for _ in shared(end.returned)):
            raise UntranslatableError  # the next message gets the same list
        return end

    def _arguments(self, called: Function, node: ast.Call, state: State) -> dict[str, Value]:
        args = called.node.args
        names, plain = parameters(called.node), len(args.posonlyargs) + len(args.args)
        if args.vararg or args.kwarg or len(node.args) > plain:
            raise UntranslatableError
        found = {n: evaluate(a, state, self) for n, a in zip(names, node.args, strict=False)}
        found |= {k.arg: evaluate(k.value, state, self) for k in node.keywords if k.arg in names}
        found = dict(called.defaults) | found
        if found.keys() != set(names) or any(k.arg not in names for k in node.keywords):
            raise UntranslatableError
        return found

    def _defined(self, node: ast.FunctionDef, state: State) -> Function:
        return defined(node, lambda name: self.find(name, state), lambda e: evaluate(e, state, self), self.scope)

    def follow(self, body: Sequence[ast.stmt], state: State) -> End:
        """Follow a function's statements to their end. Raises `UntranslatableError`."""
        end = self._follow(body, state)
        if end.state.fails == Const(None):
            return end
        return End(each(end.state.fails, lambda _: end.returned or Const(None)), end.state)

    def _follow(self, body: Sequence[ast.stmt], state: State) -> End:
        for i, statement in enumerate(body):
            self.steps += 1
            if self.steps > _MAX_STEPS:
                raise UnfollowableError
            try:
                end = self._statement(statement, body[i + 1 :], state)
            except UnfollowableError:
                raise
            except UntranslatableError:
                if self.stream is None and not self.depth:  # what the module itself does counts for all that follows
                    raise UnfollowableError from None
                leave(statement, state, self)
                continue
            if end is not None:
                return end
        return End(None, state)

    def _statement(self, statement: ast.stmt, rest: Sequence[ast.stmt], state: State) -> End | None:  # noqa: C901, PLR0911, PLR0912
        match statement:
            case ast.Return(value):
                return self._return(value, state)
            case ast.Assign(targets, value):
                return self._assigned(targets, self._worth(value, state), state)
            case ast.AnnAssign(target, _, ast.expr() as value):
                return self._assigned([target], self._worth(value, state), state)
            case ast.AugAssign(target, op, value):
                return self._assigned([target], self._augmented(target, op, value, state), state)
            case ast.If(test, body, orelse):
                return self._branch(collapsed(each(self._worth(test, state), truth)), body, orelse, rest, state)
            case ast.For(target, over, body, []):
                return self._loop(target, self._worth(over, state), body, rest, state)
            case ast.Raise():
                return End(Raises("raise", stated=True), state)
            case ast.Assert(test):
                failing = ast.If(ast.UnaryOp(ast.Not(), test), [ast.Raise()], [])
                return self._statement(failing, rest, state)
            case ast.Try(body, [_, *_], orelse, []):
                return self._try(statement, rest, state)
            case ast.FunctionDef(name):
                self.assign(ast.Name(name), self._defined(statement, state), state)
            case ast.Expr(ast.Call() as call):
                return self._called(call, state)
            case ast.Expr(ast.Name(name)) if name.startswith(".") and is_lost(state.variables[name], state, self):
                raise UnfollowableError  # what a loop goes over, that its own statements gave away
            case ast.Import() | ast.ImportFrom():
                for own, thing in imported(statement).items():
                    self.assign(ast.Name(own), thing, state)
            case ast.Pass() | ast.Global() | ast.Expr(ast.Constant() | ast.Name()) | ast.AnnAssign(value=None):
                pass
            case _:
                raise UntranslatableError
        return None

    def visible(self, state: State) -> list[tuple[str, Value]]:
        """All names and what they stand for, those of the functions around and of the module among them."""
        found = [*self.constants.items()] if state.variables is not self.constants else []
        while True:
            found += state.variables.items()
            if state.around is None:
                return found
            state = state.around

    def _return(self, value: ast.expr | None, state: State) -> End:
        if value is None:
            return End(Const(None), state)
        try:
            return End(evaluate(value, state, self), state)
        except UnfollowableError:
            raise
        except UntranslatableError:
            leave(ast.Expr(value), state, self)
            return End(Unread(ast.unparse(value)), state)

    def _worth(self, node: ast.expr, state: State) -> Value:
        """What an expression of a statement is worth; where a function fails in it by itself, all of this one does."""
        found = evaluate(node, state, self)
        if any(isinstance(leaf, Raises) and leaf.stated for leaf in leaves(found)):
            self._fail(found, state)
        return found

    def _fail(self, found: Value, state: State) -> None:
        """Note where a value is an error. Raises `UnfollowableError` where that grows too large."""
        try:
            state.fails = each(found, lambda _: state.fails)
        except UntranslatableError:
            raise UnfollowableError from None

    def _assigned(self, targets: list[ast.expr], value: Value, state: State) -> End | None:
        if isinstance(value, Raises):
            return End(value, state)
        for target in targets:
            self.assign(target, value, state)
        return None

    def assign(self, target: ast.expr, value: Value, state: State) -> None:
        """Assign to a variable, to a predicate, or to several. Raises `UntranslatableError`."""
        match target:
            case ast.Name("predicates"):
                raise UnfollowableError
            case ast.Name(name):
                state.variables[name] = value
            case ast.Subscript(ast.Name("predicates"), index):
                key = evaluate(index, state, self)
                if not isinstance(key, Const) or not isinstance(key.value, str):
                    raise UnfollowableError
                state.predicates[str(key.value)] = value
                keep(shared(value), self)
            case ast.Tuple(parts) | ast.List(parts):
                values = [Const(v) for v in value.value] if isinstance(value, Const) and isinstance(
                    value.value, list | tuple) else list(value.values) if isinstance(value, Items) else []  # fmt: skip
                if len(values) != len(parts):
                    raise UntranslatableError
                for part, item in zip(parts, values, strict=True):
                    self.assign(part, item, state)
            case _:
                raise UnfollowableError

    def _augmented(self, target: ast.expr, op: ast.operator, value: ast.expr, state: State) -> Value:
        """Raises `UnfollowableError` where a list grows that has another name, too."""
        more = self._worth(value, state)
        if isinstance(target, ast.Name):
            own = set(shared(self.find(target.id, state)))
            lists = {ref for ref in own if isinstance(ref, Thing)}
            if any(n != target.id and lists & set(shared(v)) for n, v in self.visible(state) if n[0] != "."):
                raise UnfollowableError
            if grows(op, more):
                lose(own - lists, state, self)
        return arithmetic(self._worth(target, state), op, more)

    def _branch(
        self, test: Value, body: Sequence[ast.stmt], orelse: Sequence[ast.stmt], rest: Sequence[ast.stmt], state: State
    ) -> End | None:
        if isinstance(test, Raises):
            return End(test, state)
        if isinstance(test, Const):
            return self._follow([*(body if test.value else orelse), *rest], state)
        ends = any(isinstance(n, ast.Return) for s in (*body, *orelse) for n in ast.walk(s))
        more = rest if ends else ()
        yes = self._follow([*body, *more], state.copy())
        no = self._follow([*orelse, *more], state.copy())
        for end in () if ends else (yes, no):  # it goes on, but where it failed
            end.state.fails = end.returned or end.state.fails
        after = merged(test, yes.state, no.state)
        state.variables, state.predicates, state.fails = after.variables, after.predicates, after.fails
        state.lost = after.lost
        if not ends:
            return End(state.fails, state) if isinstance(state.fails, Raises) else None
        return End(choice(test, yes.returned or Const(None), no.returned or Const(None)), state)

    def _loop(
        self, target: ast.expr, over: Value, body: Sequence[ast.stmt], rest: Sequence[ast.stmt], state: State
    ) -> End:
        if any(isinstance(n, ast.Break | ast.Continue) for s in body for n in ast.walk(s)):
            raise UntranslatableError
        if isinstance(over, Const) and isinstance(over.value, str | list | tuple | dict):
            values: list[Value] = [Const(v) for v in over.value]
        elif isinstance(over, Items):
            values = list(over.values)
        else:
            raise UntranslatableError
        whole = f".{id(body)}"
        state.variables[whole] = over
        unrolled: list[ast.stmt] = []
        for i, value in enumerate(values[:65]):
            state.variables[f"{whole}.{i}"] = value
            unrolled += [ast.Assign([target], ast.Name(f"{whole}.{i}")), *body, ast.Expr(ast.Name(whole))]
        if len(values) > 64:
            raise UntranslatableError
        return self._follow([*unrolled, *rest], state)

    def _try(self, statement: ast.Try, rest: Sequence[ast.stmt], state: State) -> End:
        """`try: return float(x)`, with the handler's value for what is none; other failures of CEL are unknown."""
        match statement:
            case ast.Try([ast.Return(ast.Call(ast.Name("float" | "int" as word), [asked], []))], [handler], [], []):
                pass
            case _:
                raise UntranslatableError
        kinds = handler.type.elts if isinstance(handler.type, ast.Tuple) else [handler.type]
        if not {k.id if isinstance(k, ast.Name) else "" for k in kinds} <= {"TypeError", "ValueError"}:
            raise UntranslatableError
        after = state.copy()
        caught = self.follow([*handler.body, *rest], after).returned or Const(None)
        kept = {n: v for n, v in after.predicates.items() if n in state.predicates and same(v, state.predicates[n])}
        if kept != after.predicates:
            raise UnfollowableError
        state.lost |= after.lost

        def read(leaf: Leaf) -> Value:
            found = function(word, [leaf])
            if isinstance(leaf, Field):
                return choice(Term(f"{field_text(leaf.path)} == null", "bool"), caught, found)
            return caught if isinstance(found, Raises) else found

        return End(each(evaluate(asked, state, self), read), state)

    def _called(self, call: ast.Call, state: State) -> End | None:
        match call:
            case ast.Call(ast.Name(name)) if isinstance(called := self.find(name, state), Function):
                end = self._enter(called, call, state)
                state.predicates = end.state.predicates
                self._forget(set_outside(called.node, self.scope), state, Unread(ast.unparse(call)))
                for found in (end.returned or Const(None), *(self._worth(a, state) for a in call.args)):
                    self._fail(found, state)
                return End(state.fails, state) if isinstance(state.fails, Raises) else None
            case ast.Call(ast.Attribute(ast.Name("sys"), "exit")):
                return End(Raises("SystemExit", stated=True), state)
            case _ if self._is_log(call, state):
                leave(ast.Expr(call), state, self)
                return None
            case ast.Call(ast.Attribute(ast.Name("predicates"), "update"), arguments, keywords):
                self._update(arguments, keywords, state)
                return None
        raise UnfollowableError

    def _forget(self, names: set[str], state: State, unread: Unread) -> None:
        """A function that was called may have set these variables of the module; who declares them has them here."""
        frame: State | None = state
        while frame is not None:
            frame.variables |= dict.fromkeys(names & frame.variables.keys(), unread)
            frame = frame.around

    def _is_log(self, call: ast.Call, state: State) -> bool:
        """Whether a call only tells people something: by a name that is not one of the module's own values."""
        name = root(call.func)
        found = self.find(name, state) if name in LOGS and not self.opaque else None
        known = [] if found is None else leaves(found)
        return name in LOGS and all(isinstance(leaf, Imported | Unread) for leaf in known)

    def _update(self, arguments: list[ast.expr], keywords: list[ast.keyword], state: State) -> None:
        for argument in arguments:
            if not isinstance(argument, ast.Dict):
                raise UnfollowableError
            for key, value in zip(argument.keys, argument.values, strict=True):
                if not isinstance(key, ast.Constant) or not isinstance(key.value, str):
                    raise UnfollowableError
                keywords = [*keywords, ast.keyword(key.value, value)]
        for keyword in keywords:
            if keyword.arg is None:
                raise UnfollowableError
            try:
                state.predicates[keyword.arg] = self._worth(keyword.value, state)
                keep(shared(state.predicates[keyword.arg]), self)
            except UntranslatableError:
                state.predicates[keyword.arg] = Unread(ast.unparse(keyword))
