"""Commands as users run them: each a process of its own, which keeps what it has traced for the next one."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

COMMANDS = {
    "estimate": ("estimate", "{log}", "--estimator", "kmbe", "--out", "{out}"),
    "smooth": ("estimate", "{log}", "--estimator", "kmbe", "--smooth", "--out", "{out}"),
    "calibrate": ("calibrate", "{log}", "--estimator", "kmbe", "--tune", "--out", "{out}/new.yaml"),
}


@pytest.fixture(scope="module")
def minute_csv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minute of driving."""
    rows = ["time,speed,accel_x"]
    for k in range(1200):
        speed, accel = 20 + 5 * ((k // 40) % 2) + 0.1 * (k % 3), 0.1 * (k % 5)
        rows.append(f"{0.05 * k:.2f},{speed:.2f},{accel:.2f}")
    path = tmp_path_factory.mktemp("minute") / "minute.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("command", COMMANDS)
def test_it_ends_well_at_first_and_by_what_is_kept(command: str, minute_csv: Path, tmp_path: Path) -> None:
    cache, said = tmp_path / "cache", []
    usual = {**os.environ, "XDG_CACHE_HOME": str(cache), "COLUMNS": "80"}
    for _ in range(2):
        words = [word.format(log=minute_csv, out=tmp_path / "out") for word in COMMANDS[command]]
        end = subprocess.run(
            [sys.executable, "-m", "roadstate", *words, "--vehicle", "family-car"],
            env=usual, capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        assert end.returncode == 0, end.stderr
        said.append(end.stdout)
    assert list(cache.rglob("*.traced"))
    assert said[0] == said[1]
