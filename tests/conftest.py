"""What takes long on a busy machine is not wrong: no example has a deadline. Nor does a terminal's width count."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

settings.register_profile("patient", settings(deadline=None, suppress_health_check=[HealthCheck.too_slow]))
settings.load_profile("patient")

os.environ.pop("COLUMNS", None)
