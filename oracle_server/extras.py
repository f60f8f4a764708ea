"""How what an extra needs is installed beside this package, by whatever it was installed itself."""

from __future__ import annotations

import shlex
import sys
from importlib.util import find_spec


def install(extra: str) -> str:
    """The command that installs an extra where this package is.

    It names this Python: a `pip` of the shell is another one where pipx or uv made the environment, and there it would
    look for a package of this name at an index, where it is not this one.
    """
    python = shlex.quote(sys.executable)
    pip = f"{python} -m pip install" if find_spec("pip") is not None else f"uv pip install --python {python}"
    return f"{pip} 'oracle-server[{extra}]'"
