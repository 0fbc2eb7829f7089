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


@pytest.mark.parametrize("command", COMMANDS)
def test_it_ends_well_at_first_and_by_what_is_kept(command: str, noisy: Path, tmp_path: Path) -> None:
    cache, said = tmp_path / "cache", []
    usual = {**os.environ, "XDG_CACHE_HOME": str(cache), "COLUMNS": "80"}
    for _ in range(2):
        words = [word.format(log=noisy, out=tmp_path / "out") for word in COMMANDS[command]]
        end = subprocess.run(
            [sys.executable, "-m", "roadstate", *words, "--vehicle", "family-car"],
            env=usual, capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        assert end.returncode == 0, end.stderr
        said.append(end.stdout)
    assert list(cache.rglob("*.traced"))
    assert said[0] == said[1]
