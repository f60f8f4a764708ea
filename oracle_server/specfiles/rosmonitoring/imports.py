"""What a module's imports bind: names that are not known, but for those of Python's own `math`."""

from __future__ import annotations

import ast
import math

from oracle_server.specfiles.rosmonitoring.values import Imported, UnfollowableError


def imported(statement: ast.Import | ast.ImportFrom) -> dict[str, Imported]:
    """The names that an import binds. Raises `UnfollowableError` where they may be any."""
    where = "" if isinstance(statement, ast.Import) else f"{'.' * statement.level}{statement.module or ''}."
    found: dict[str, Imported] = {}
    for alias in statement.names:
        if alias.name != "*":
            name = alias.name if alias.asname else alias.name.split(".")[0]
            found[alias.asname or name] = Imported(where + name)
        elif where == "math.":
            found |= {name: Imported(where + name) for name in vars(math) if not name.startswith("_")}
        else:
            raise UnfollowableError
    return found
