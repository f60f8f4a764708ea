"""XML-RPC with a time limit: a machine that vanishes leaves connections open that stay silent."""

from __future__ import annotations

from http.client import HTTPConnection
from typing import Any
from xmlrpc.client import Transport


class TimedTransport(Transport):
    """HTTP with a time limit."""

    def __init__(self, seconds: float) -> None:
        """Wait so long for a connection, and for each reply."""
        super().__init__()
        self._seconds = seconds

    def make_connection(self, host: Any) -> HTTPConnection:
        """Make a connection with the time limit."""
        connection = super().make_connection(host)
        connection.timeout = self._seconds
        return connection
