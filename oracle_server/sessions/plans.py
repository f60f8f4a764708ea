"""The plans of sessions that are restored: most have a spec of the library, or the same as another one."""

from __future__ import annotations

from oracle_server.core.errors import OracleError
from oracle_server.core.plan import Plan, judged_by, plan
from oracle_server.history.records import SessionRecord
from oracle_server.specfiles.library import Entry, Unsound
from oracle_server.specfiles.load import parse_spec


class Plans:
    """Makes each plan once."""

    def __init__(self, listed: list[Entry | Unsound]) -> None:
        known = [entry for entry in listed if isinstance(entry, Entry)]
        self._made: dict[str, Plan | OracleError] = {entry.file.text: entry.plan for entry in known}

    def of(self, opened: SessionRecord) -> Plan:
        """The plan of a session's spec, as it was opened. Raises `OracleError` where this version refuses it."""
        made = self._made.get(opened.text)
        if made is None:
            made = self._made[opened.text] = _planned(opened)
        if isinstance(made, OracleError):
            raise made
        return judged_by(made, opened.by)


def _planned(opened: SessionRecord) -> Plan | OracleError:
    try:
        return plan(parse_spec(opened.text, opened.id, bounded=False).spec)
    except OracleError as error:
        return error
