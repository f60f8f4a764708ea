"""The wire's documentation: the schema on disk is that of the models."""

import json
from pathlib import Path

from oracle_server.wire.outgoing import schema

ROOT = Path(__file__).parents[2]


def test_the_schema_in_docs_is_that_of_the_models() -> None:
    written = json.loads((ROOT / "docs/wire.schema.json").read_text())
    assert written == schema(), "run: python -m oracle_server.wire.outgoing > docs/wire.schema.json"
