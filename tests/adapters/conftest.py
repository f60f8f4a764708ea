"""The server's fixtures, for the link's tests against it."""

from tests.server.conftest import start

__all__ = ["start"]
