"""Tables for people: they fit the terminal, and have colour on terminals only."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import IO

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

from oracle_server.core.errors import one_line

ELSEWHERE = 160
"""Columns where the output is no terminal, and COLUMNS does not say otherwise."""
_GAP = 2
_STYLES = {
    "false": "bold red",
    "currently_false": "red",
    "unknown": "yellow",
    "true": "bold green",
    "deny": "red",
}
"""How cells are shown that say what is wrong, or final."""


def print_table(head: Sequence[str], rows: Sequence[Sequence[str]], out: IO[str]) -> None:
    """Print rows of texts under a head."""
    console = Console(file=out, highlight=False, width=None if out.isatty() or "COLUMNS" in os.environ else ELSEWHERE)
    console.print(table(head, rows, console.width))


def table(head: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> Table:
    """Rows of texts under a head, of which nothing is a control character or markup, in so many columns.

    Where they are too wide, cells of several words are broken between these first, those on the right before others;
    then names are.
    """
    lines = [[one_line(cell) for cell in row] for row in rows]
    columns = [[name, *cells] for name, cells in zip(head, zip(*lines, strict=True), strict=True)] if lines else []
    wide = [max(map(cell_len, column)) for column in columns]
    made = Table(box=None, pad_edge=False)
    for index in reversed(range(len(columns))):
        if sum(wide) + _GAP * (len(wide) - 1) > width:
            name, *cells = columns[index]
            wide[index] = max(map(cell_len, [name, *(word for cell in cells for word in cell.split())]))
    for index, name in enumerate(head):
        made.add_column(name, overflow="fold", max_width=wide[index] if columns else None)
    for line in lines:
        made.add_row(*(Text(cell, _STYLES.get(cell, "")) for cell in line))
    return made
