"""From where on a session's verdicts are kept: a list of violations alone would say that there were none before."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from oracle_server.cli.client import Client, of_session


def not_kept(client: Client, session: str, state: dict[str, Any], only: Collection[str] = ()) -> str:
    """A line that says of which verdicts there is nothing more, empty where no property was violated among them.

    Of `only` some properties, where these are named.
    """
    first_ones = [each.get("first_violation") for each in state["properties"] if not only or each["id"] in only]
    violated = [each for each in first_ones if each is not None]
    if not violated:
        return ""
    oldest = client.get(of_session(session, "verdicts"), limit=1)["items"]
    if not oldest or oldest[0]["n"] <= min(violated):
        return ""
    return f"what was before verdict #{oldest[0]['n']}, and was violated, too, is not kept any more\n"
