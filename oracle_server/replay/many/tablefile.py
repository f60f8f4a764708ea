"""Tables of results as files: Parquet, JSON Lines and CSV, written and read again."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple, get_args, get_type_hints

import msgspec

from oracle_server.core.errors import OracleError
from oracle_server.extras import install
from oracle_server.replay.many.row import COLUMNS, Row
from oracle_server.replay.report.table import SPREADSHEET, csv_cell

_LONGEST = 2**31 - 1
"""Characters of a cell."""
_GROUP = 10_000
"""Rows that are written at once."""


class ResultsError(OracleError):
    """A file of results that can't be read or written."""


class Format(NamedTuple):
    """How a table is written to a file that is opened for bytes, and read from a path."""

    write: Callable[[Iterable[Row], IO[bytes]], None]
    read: Callable[[Path], Iterator[Row]]


def format_of(path: Path) -> Format:
    """The format that a file is to have by its name. Raises `ResultsError`."""
    found = _FORMATS.get(path.suffix)
    if found is None:
        raise ResultsError(f"--out {path}: write a name that ends with {', '.join(_FORMATS)}")
    if path.suffix == ".parquet":
        _pyarrow(path)
    return found


def read_rows(path: Path) -> Iterator[Row]:
    """The rows of a file that was written before. Raises `ResultsError`."""
    read = format_of(path).read
    try:
        yield from read(path)
    except OSError as error:
        raise ResultsError(f"{path}: can't be read: {error.strerror or error}") from None
    except (ValueError, TypeError, LookupError, csv.Error):  # pyarrow's and msgspec's errors are of these
        raise ResultsError(f"{path}: is there already, and is no table of results: name another file") from None


def write_csv(rows: Iterable[Row], out: IO[str], *, headed: bool = True) -> None:
    """Rows as comma-separated values; with `headed` below the names of the columns."""
    table = csv.writer(out)
    if headed:
        table.writerow(COLUMNS)
    for row in rows:
        table.writerow([csv_cell(value) for value in msgspec.structs.astuple(row)])


def _write_csv(rows: Iterable[Row], out: IO[bytes]) -> None:
    class Encoded:
        def write(self, text: str) -> int:
            return out.write(text.encode())

    write_csv(rows, Encoded())  # type: ignore[arg-type]


def _read_csv(path: Path) -> Iterator[Row]:
    with path.open(encoding="utf-8", newline="") as file:
        csv.field_size_limit(_LONGEST)
        table = csv.DictReader(file)
        if tuple(table.fieldnames or ()) != COLUMNS:
            raise ValueError("these are other columns")
        for cells in table:
            yield msgspec.convert({name: _READ[name](cells[name]) for name in COLUMNS}, Row)


def _text(cell: str) -> str:
    return cell[1:] if cell.startswith("'") and cell[1:2] in SPREADSHEET else cell


def _reader(hint: Any) -> Callable[[str], object]:
    """What makes a cell of CSV the value of a column."""
    kinds: tuple[tuple[type, Callable[[str], object]], ...] = (
        (bool, lambda cell: {"true": True, "false": False}[cell]), (int, int), (float, float)
    )  # fmt: skip
    read = next((read for kind, read in kinds if kind is hint or kind in get_args(hint)), _text)
    return lambda cell: read(cell) if cell else None


_READ = {name: _reader(hint) for name, hint in get_type_hints(Row).items()}


def _write_lines(rows: Iterable[Row], out: IO[bytes]) -> None:
    for row in rows:
        out.write(msgspec.json.encode(row) + b"\n")


def _read_lines(path: Path) -> Iterator[Row]:
    decoder = msgspec.json.Decoder(Row)
    with path.open("rb") as file:
        yield from map(decoder.decode, file)


def _write_parquet(rows: Iterable[Row], out: IO[bytes]) -> None:
    import pyarrow
    from pyarrow import parquet

    kinds = {int: pyarrow.int64(), float: pyarrow.float64(), bool: pyarrow.bool_()}
    hints = get_type_hints(Row)
    fields = [
        (name, next((kind for of, kind in kinds.items() if of is hint or of in get_args(hint)), pyarrow.string()))
        for name, hint in hints.items()
    ]
    schema = pyarrow.schema(fields)
    remaining = iter(rows)
    with parquet.ParquetWriter(out, schema, compression="zstd") as table:
        while group := list(itertools.islice(remaining, _GROUP)):
            columns = zip(*map(msgspec.structs.astuple, group), strict=True)
            arrays = [pyarrow.array(column, kind) for column, (_, kind) in zip(columns, fields, strict=True)]
            table.write_table(pyarrow.Table.from_arrays(arrays, schema=schema))


def _read_parquet(path: Path) -> Iterator[Row]:
    from pyarrow import parquet

    with parquet.ParquetFile(path) as file:
        if tuple(file.schema_arrow.names) != COLUMNS:
            raise ValueError("these are other columns")
        for batch in file.iter_batches(_GROUP):
            for row in batch.to_pylist():
                yield msgspec.convert(row, Row)


def _pyarrow(path: Path) -> None:
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise ResultsError(
            f"--out {path}: Parquet needs the package pyarrow; install it: `{install('parquet')}`; "
            ".jsonl and .csv need nothing"
        ) from None


_FORMATS = {
    ".parquet": Format(_write_parquet, _read_parquet),
    ".jsonl": Format(_write_lines, _read_lines),
    ".csv": Format(_write_csv, _read_csv),
}
