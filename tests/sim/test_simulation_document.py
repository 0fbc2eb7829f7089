"""docs/simulation.md says what the code does."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from roadstate.sim.manoeuvres import all_manoeuvres
from roadstate.sim.roads import parse_road
from roadstate.sim.sensors import KINDS, PRESETS

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "simulation.md").read_text(encoding="utf-8")


def test_road_file_of_the_page_can_be_built() -> None:
    blocks = re.findall(r"^```yaml\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    assert len(blocks) == 1
    road = parse_road(blocks[0], "simulation.md").build()
    assert np.asarray(road.at([110.0, 110.0], [-1.0, 1.0]).friction) == pytest.approx([0.2, 0.85])


def test_table_of_manoeuvres_is_the_codes() -> None:
    rows = re.findall(r"^\| `([a-z0-9-]+)` \| (\d+) \| ([\d.]+) \| (.*) \| (.*) \|$", PAGE, re.MULTILINE)
    expected = [
        (name, f"{3.6 * kind.speed:.0f}", f"{kind.friction:g}", kind.summary, kind.source)
        for name, kind in all_manoeuvres().items()
    ]
    assert rows == expected


def test_presets_and_faults_are_named() -> None:
    for name in (*PRESETS, *KINDS):
        assert f"`{name}`" in PAGE
