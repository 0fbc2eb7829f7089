"""What a person is told of a result beside sensors' faults."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core import Estimates
from roadstate.estimators.remarks import remarks


def learnt(mass: np.ndarray, std: float) -> Estimates:
    count = len(mass)
    return Estimates(
        time=np.arange(count, dtype=float),
        values={"mass": mass},
        std={"mass": np.full(count, std)},
        validity=np.zeros(count, np.int8),
        sensors=(),
        innovation=np.zeros((count, 0)),
        innovation_std=np.zeros((count, 0)),
        nis=np.full(count, np.nan),
    )


@pytest.mark.parametrize(
    ("mass", "std", "says"),
    [
        (
            [1500, 2550, 2550],
            60,
            "2550 kg in the end, 70 % more than the vehicle file's 1500 kg: a load, a trailer",
        ),
        (
            [1500, 900, np.nan],
            60,
            "900 kg in the end, 40 % less than the vehicle file's 1500 kg: an unladen car",
        ),
        ([1500, 1800, 1800], 60, None),
        ([1500, 2100, 2100], 400, None),
    ],
)
def test_a_mass_far_from_the_files_is_remarked_on(mass: list[float], std: float, says: str | None) -> None:
    found = remarks(learnt(np.array(mass, dtype=float), std), 1500.0, None)
    assert len(found) == (says is not None)
    assert says is None or says in found[0]


def test_who_learns_no_mass_gives_cause_for_no_remark() -> None:
    estimates = learnt(np.array([1500.0]), 60)
    empty = Estimates(**{**estimates.__dict__, "values": {}, "std": {}})
    assert remarks(empty, 900.0, 0.1) == []


@pytest.mark.parametrize(
    ("bias", "says"),
    [
        (-0.35, "tilted by 4 %, or ground that holds back more (snow, gravel"),
        (0.35, "tilted by 4 %; raise"),
        (0.25, None),
    ],
)
def test_a_bias_far_from_the_files_is_remarked_on(bias: float, says: str | None) -> None:
    estimates = learnt(np.array([1500.0, 1500.0]), 60)
    values = {"accel_x_bias": np.array([0.0, bias])}
    found = remarks(Estimates(**{**estimates.__dict__, "values": values, "std": values}), 900.0, 0.1)
    assert len(found) == (says is not None)
    assert says is None or says in found[0]
