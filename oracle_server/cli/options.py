"""Options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def named(value: str) -> Path:
    """A file or folder that is named: an empty text, as of a variable that is not set, would be the working directory.

    Raises `typer.BadParameter` for that.
    """
    if not value.strip():
        raise typer.BadParameter("it is empty: leave it out, or name a file or a folder")
    return Path(value)


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
DataDir = Annotated[Path | None, typer.Option(parser=named, metavar="<path>", help="The directory of the history.")]
SpecFiles = Annotated[list[Path], typer.Argument(metavar="SPEC…", help="Spec files.")]
TypeFolders = Annotated[
    list[Path] | None,
    typer.Option(
        "--types", parser=named, metavar="FOLDER", help="A folder with .msg, .srv and .action files; repeatable."
    ),
]
