"""The committed table of consistency has a row for every filter that there is."""

from __future__ import annotations

from pathlib import Path

import pytest

from roadstate.filters import all_filters

TABLE = Path(__file__).parents[2] / "benchmarks" / "results" / "consistency.md"
HONEST = ("ekf", "iekf", "imm", "kf", "marginal-ukf", "ukf")


@pytest.fixture(scope="module")
def rows() -> dict[str, list[str]]:
    matched = TABLE.read_text(encoding="utf-8").split("Matched, every filter")[1].split("\n\n")[1]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in matched.splitlines()]
    return {row[0]: row[1:] for row in cells[2:]}


def test_it_says_how_it_is_made() -> None:
    assert "python -m benchmarks.consistency" in TABLE.read_text(encoding="utf-8").splitlines()[2]


@pytest.mark.parametrize("name", all_filters())
def test_every_filter_is_in_it(rows: dict[str, list[str]], name: str) -> None:
    nees, share, verdict, *_, why = rows[name]
    assert float(nees) > 0
    assert verdict == ("inside" if float(share) >= 85 else "above" if float(nees) > 1 else "below")
    assert (verdict == "inside") == (why == ""), "one that is not consistent says why"


@pytest.mark.parametrize("name", HONEST)
def test_those_whose_covariance_is_one_are_consistent(rows: dict[str, list[str]], name: str) -> None:
    assert rows[name][2] == "inside"
