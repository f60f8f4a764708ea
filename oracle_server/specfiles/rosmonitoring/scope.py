"""Which names Python's statements bind, hand on and change, and which names may change something when they are used."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

MUTATORS = frozenset({
    "add", "append", "appendleft", "clear", "difference_update", "discard", "extend", "extendleft", "insert",
    "intersection_update", "move_to_end", "pop", "popitem", "popleft", "remove", "reverse", "rotate", "setdefault",
    "sort", "symmetric_difference_update", "update",
})  # fmt: skip
"""Methods that change what they belong to."""
LOGS = frozenset({"print", "logging", "logger", "log", "rospy", "sys", "warnings"})
"""What tells people something, and changes nothing that is judged."""
ANYTHING = frozenset({
    "__builtins__", "__dict__", "__globals__", "__import__", "builtins", "delattr", "eval", "exec", "f_globals",
    "globals", "locals", "modules", "setattr", "vars",
})  # fmt: skip
"""Words by which a name may be bound that is not in the text; `modules` is that of `sys`, `vars` that of nothing."""
READ = frozenset({"copy", "count", "get", "index", "items", "keys", "values"})
"""Methods that only look into a list or dict."""
SHARING = frozenset({
    "copy", "dict", "enumerate", "frozenset", "list", "max", "min", "reversed", "set", "sorted", "sum", "tuple", "zip",
})  # fmt: skip
"""Functions whose value may have what they were given in it."""
MODULES = frozenset({"copy", "deepcopy", "json", "math", "os", "re", *LOGS})
"""What is imported and only looks into what it is given."""
_READERS = frozenset({
    "abs", "all", "any", "bin", "bool", "bytes", "chr", "divmod", "float", "format", "hash", "hex", "id", "int",
    "isinstance", "len", "oct", "ord", "pow", "range", "repr", "round", "str", "type", *SHARING, *MODULES,
})  # fmt: skip

Definitions = Mapping[str, Sequence[ast.AST]]
"""What may stand behind a name anywhere in a module: functions, classes, and the expressions that it is given."""


@dataclass(frozen=True, slots=True)
class Scope:
    """What is known of a module's names from its text alone.

    Those of `changing` keep something from one message to the next; to use one of `changers` may change something, and
    to use one of `failing` may raise an error.
    """

    changing: frozenset[str] = frozenset()
    changers: frozenset[str] = frozenset()
    failing: frozenset[str] = frozenset()
    definitions: Definitions = field(default_factory=dict)


def read_scope(tree: ast.Module) -> Scope:
    """What is known of a module's names."""
    known = definitions(tree)
    return Scope(
        frozenset(_changing(tree)) - {"predicates"}, _reaching(known, _changes), _reaching(known, raises), known
    )


def _changing(tree: ast.Module) -> Iterator[str]:
    """The names that functions may change from one message to the next."""
    functions = (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda))
    for node in (n for function in functions for n in ast.walk(function)):
        match node:
            case ast.Global(names) | ast.Nonlocal(names):
                yield from names
            case ast.Subscript(base, ctx=ast.Store() | ast.Del()) | ast.Attribute(base, ctx=ast.Store() | ast.Del()):
                yield root(base)
            case ast.Call(ast.Attribute(base, method)) if method in MUTATORS:
                yield root(base)


def _reaching(known: Definitions, does: Callable[[ast.AST], bool]) -> frozenset[str]:
    """The names behind which some function does something, or mentions one that does."""
    found = {name for name, nodes in known.items() if any(does(f) for n in nodes for f in _functions(n))}
    words = {name: set[str]().union(*map(mentioned, nodes)) for name, nodes in known.items()}
    while more := {name for name in words.keys() - found if words[name] & found}:
        found |= more
    return frozenset(found)


def _functions(node: ast.AST) -> Iterator[ast.AST]:
    """What runs only when it is called: the node itself, or the lambdas of an expression."""
    if isinstance(node, ast.expr):
        yield from (n for n in ast.walk(node) if isinstance(n, ast.Lambda))
    else:
        yield node


def _changes(function: ast.AST) -> bool:
    """Whether a function changes anything, but lists and dicts of its own, and what an object keeps for itself."""
    fresh = _made_inside(function)
    for node in ast.walk(function):
        match node:
            case ast.Attribute(ast.Name("self"), ctx=ast.Store()):
                pass
            case ast.Attribute(ctx=ast.Store() | ast.Del()) | ast.Subscript(ctx=ast.Store() | ast.Del()):
                return True
            case ast.Global() | ast.Nonlocal():
                return True
            case ast.Call(ast.Attribute(base, method)) if method in MUTATORS and root(base) not in fresh:
                return True
    return binds_unseen(function)


def raises(node: ast.AST) -> bool:
    """Whether statements raise errors by themselves."""
    return any(isinstance(n, ast.Raise | ast.Assert) for n in ast.walk(node))


def _made_inside(function: ast.AST) -> set[str]:
    """The variables that are never anything but lists, sets and dicts that the function made."""
    made: set[str] = set()
    other = {n.arg for n in ast.walk(function) if isinstance(n, ast.arg)}
    for name, values in definitions(function).items():
        new = all(
            isinstance(v, ast.List | ast.Dict | ast.Set | ast.ListComp | ast.SetComp | ast.DictComp)
            or (isinstance(v, ast.Call) and root(v.func) in ("list", "dict", "set", "deque"))
            for v in values
        )
        (made if new else other).add(name)
    return made - other


def bound(body: Iterable[ast.AST]) -> set[str]:
    """The names that statements bind in their own scope, those that they declare global among them."""
    found: set[str] = set()
    for node in _own(body):
        match node:
            case ast.Name(name, ast.Store() | ast.Del()):
                found.add(name)
            case ast.FunctionDef(name) | ast.AsyncFunctionDef(name) | ast.ClassDef(name):
                found.add(name)
            case ast.Import(names) | ast.ImportFrom(_, names):
                found |= {alias.asname or alias.name.split(".")[0] for alias in names}
            case ast.ExceptHandler(_, str() as name) | ast.MatchAs(_, str() as name) | ast.MatchStar(str() as name):
                found.add(name)
            case ast.MatchMapping(_, _, str() as name):
                found.add(name)
    return found


def declared(body: Iterable[ast.AST]) -> set[str]:
    """The names that a scope's statements declare global, or of a function around."""
    return {name for node in _own(body) if isinstance(node, ast.Global | ast.Nonlocal) for name in node.names}


def waits(body: Iterable[ast.AST]) -> bool:
    """Whether a scope's statements make its function a generator, or a coroutine."""
    return any(isinstance(node, ast.Yield | ast.YieldFrom | ast.Await) for node in _own(body))


def _own(body: Iterable[ast.AST]) -> Iterator[ast.AST]:
    """The nodes of a scope, without what functions, classes and comprehensions have for themselves."""
    for node in body:
        yield node
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield from _own(node.decorator_list)
            case ast.Lambda():
                pass
            case ast.comprehension(_, over, ifs):
                yield from _own([over, *ifs])
            case _:
                yield from _own(ast.iter_child_nodes(node))


def definitions(tree: ast.AST) -> Definitions:
    """What may stand behind each name of a module, wherever it is bound."""
    found: dict[str, list[ast.AST]] = {}
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name) | ast.AsyncFunctionDef(name) | ast.ClassDef(name):
                found.setdefault(name, []).append(node)
            case ast.Assign(targets, value):
                _give(found, targets, value)
            case ast.AnnAssign(target, _, ast.expr() as value) | ast.NamedExpr(target, value):
                _give(found, [target], value)
            case ast.For(target, value) | ast.withitem(value, ast.expr() as target):
                _give(found, [target], value)
    return found


def _give(found: dict[str, list[ast.AST]], targets: Iterable[ast.expr], value: ast.expr) -> None:
    for target in targets:
        for node in ast.walk(target):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                found.setdefault(node.id, []).append(value)


def reached(node: ast.AST, known: Definitions) -> list[ast.AST]:
    """A node, what stands behind the names that it mentions, behind those that these mention, and so on."""
    found, names = [node], set[str]()
    for one in found:  # it grows
        for name in mentioned(one) - names:
            names.add(name)
            found += known.get(name, ())
    return found


def mentioned(node: ast.AST) -> set[str]:
    """The names and attributes that are read anywhere in a node."""
    names = {n.id for n in ast.walk(node) if isinstance(n, ast.Name) and not isinstance(n.ctx, ast.Store)}
    return names | {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}


def binds_unseen(node: ast.AST) -> bool:
    """Whether a node may bind names by their text alone, as with `globals()`."""
    of_others = {id(n.func) for n in ast.walk(node) if isinstance(n, ast.Call) and n.args and root(n.func) == "vars"}
    return any(
        (isinstance(n, ast.Attribute) and n.attr in ANYTHING)
        or (isinstance(n, ast.Name) and n.id in ANYTHING and id(n) not in of_others)
        for n in ast.walk(node)
    )


def binds_anything(nodes: Iterable[ast.AST]) -> bool:
    """Whether statements may bind names that are not in their text."""
    return any(
        binds_unseen(node)
        or any(isinstance(n, ast.ImportFrom) and n.names[0].name == "*" and n.module != "math" for n in ast.walk(node))
        for node in nodes
    )


def handed(node: ast.AST, known: Definitions) -> list[ast.Name]:
    """The names whose values are given away or changed as they are, and not only looked into."""
    looked: set[int] = set()
    for found in ast.walk(node):
        match found:
            case ast.Subscript(base, ctx=ast.Load()) | ast.For(_, base) | ast.comprehension(_, base):
                looked.add(id(base))
            case ast.Attribute(base, attr) if attr in READ:
                looked.add(id(base))
            case ast.Compare(_, ops, others):
                looked |= {id(o) for op, o in zip(ops, others, strict=True) if isinstance(op, ast.In | ast.NotIn)}
            case ast.Call(_, arguments) if reads_only(found, known):
                looked |= {id(a) for a in arguments}
    augmented = {id(n.target) for n in ast.walk(node) if isinstance(n, ast.AugAssign)}
    names = [n for n in ast.walk(node) if isinstance(n, ast.Name) and id(n) not in looked]
    return [n for n in names if isinstance(n.ctx, ast.Load) or id(n) in augmented]


def reads_only(call: ast.Call, known: Definitions) -> bool:
    """Whether what is called only looks into its arguments, and calls none of them, by its name.

    That name is then one that no function of the module has.
    """
    name = root(call.func)
    words = mentioned(call.func) - {name}
    if name not in _READERS or called(name, known) or any(w in MUTATORS or w.startswith("_") for w in words):
        return False
    keywords = () if name in LOGS or name == "dict" else (k.value for k in call.keywords)
    calls = any(isinstance(a, ast.Lambda) or (isinstance(a, ast.Name) and called(a.id, known)) for a in call.args)
    return not calls and all(
        isinstance(v, ast.Constant) or (isinstance(v, ast.Name) and v.id in _READERS) for v in keywords
    )


def called(name: str, known: Definitions) -> list[ast.AST]:
    """What may run where a name is called: functions and classes of the module, and those that they mention."""
    own = [function for node in known.get(name, ()) for function in _functions(node)]
    return [function for one in own for node in reached(one, known) for function in _functions(node)]


def acts(node: ast.AST, known: Definitions) -> bool:
    """Whether a node may change what is inside of a value that it only looks into.

    What it does by functions of the module that it calls is not of it.
    """
    own = {n.arg for n in ast.walk(node) if isinstance(n, ast.arg)}
    for found in ast.walk(node):
        match found:
            case ast.Attribute(ast.Name("self"), ctx=ast.Store()):
                pass
            case ast.Subscript(ctx=ast.Store() | ast.Del()) | ast.Attribute(ctx=ast.Store() | ast.Del()):
                return True
            case ast.FunctionDef() | ast.AsyncFunctionDef() if not found.decorator_list:
                pass
            case ast.ClassDef(bases=[], keywords=[], decorator_list=[]):
                pass
            case ast.AugAssign() | ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                return True
            case ast.Call(ast.Attribute(_, method)) if method in READ:
                pass
            case ast.Call(ast.Name(name)) if name not in own and _are_functions(known.get(name, ())):
                pass
            case ast.Call() if not reads_only(found, known):
                return True
    return False


def _are_functions(nodes: Sequence[ast.AST]) -> bool:
    return bool(nodes) and all(isinstance(node, ast.FunctionDef | ast.ClassDef) for node in nodes)


def root(node: ast.expr) -> str:
    """The name at the beginning of `name.a[0].b()`; empty where there is none."""
    while isinstance(node, ast.Attribute | ast.Call | ast.Subscript):
        node = node.func if isinstance(node, ast.Call) else node.value
    return node.id if isinstance(node, ast.Name) else ""
