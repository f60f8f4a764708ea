"""Options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
DataDir = Annotated[Path | None, typer.Option(help="The directory of the history.")]
SpecFiles = Annotated[list[Path], typer.Argument(metavar="SPEC…", help="Spec files.")]
TypeFolders = Annotated[
    list[Path] | None,
    typer.Option("--types", metavar="FOLDER", help="A folder with .msg, .srv and .action files; repeatable."),
]
