"""The alarms for Prometheus fire when they should, by Prometheus' own `promtool`, where that is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

RULES = Path(__file__).parents[1] / "packaging/prometheus-rules.yml"
PROMTOOL = shutil.which("promtool")
FIRING = 'count(ALERTS{alertname="PropertyViolated", alertstate="firing"}) or vector(0)'
LATER = "_x20 1x40"
"""A sample each 15 s from the fifth minute on, and 1 from the first one on."""

pytestmark = pytest.mark.skipif(
    PROMTOOL is None and not os.environ.get("CI"), reason="promtool is missing (Debian: apt-get install prometheus)"
)


@pytest.mark.parametrize(
    ("up", "started", "violations", "fires"),
    [
        ("1x60", -9_000, "0x20 1x40", 1),
        ("1x60", -9_000, LATER, 1),
        (LATER, 290, LATER, 1),
        (LATER, -9_000, LATER, 0),
    ],
    ids=["a known property", "of a session that is new", "of a server that is new", "seen by a new Prometheus"],
)
def test_a_violation_alarms_for_two_minutes(up: str, started: int, violations: str, fires: int, tmp_path: Path) -> None:
    """The episode was over before it was scraped; the server `started` so many seconds behind the beginning."""
    server, a_property = '{job="oracle", instance="a"}', '{job="oracle", instance="a", spec="s", property="p"}'
    values = {
        f"up{server}": up,
        f"process_start_time_seconds{server}": up.replace("1x", f"{started}x"),
        f"oracle_violations_total{a_property}": violations,
        f"oracle_episodes_open{a_property}": violations.replace("1x", "0x"),
    }
    test = {
        "interval": "15s",
        "input_series": [{"series": name, "values": each} for name, each in values.items()],
        "promql_expr_test": [
            {"expr": FIRING, "eval_time": time, "exp_samples": [{"labels": "{}", "value": value}]}
            for time, value in {"4m": 0, "6m": fires, "9m": 0}.items()
        ],
    }
    file = tmp_path / "test.yml"
    file.write_text(yaml.safe_dump({"rule_files": [str(RULES)], "evaluation_interval": "15s", "tests": [test]}))
    command = [str(PROMTOOL), "test", "rules", str(file)]
    ended = subprocess.run(command, check=False, capture_output=True, encoding="utf-8")
    assert ended.returncode == 0, ended.stdout + ended.stderr
