"""The server's fixtures, for the link's tests against it."""

from tests.whole.conftest import start

__all__ = ["start"]
