"""The Magic Formula against a naive scalar transcription, over random operating points."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from oracles import magic_formula as oracle
from roadstate.tires import MagicFormula, load_tir
from roadstate.tires.mf_build import PASSENGER
from roadstate.tires.mf_coefficients import DEFAULTS


def points(nominal: float, count: int, seed: int) -> list[oracle.Point]:
    rng = np.random.default_rng(seed)
    columns = (
        rng.uniform(-1.2, 1.2, count),
        rng.uniform(-0.6, 0.6, count),
        rng.uniform(-0.15, 0.15, count),
        rng.uniform(0.1, 2.0, count) * nominal,
        rng.uniform(1.6e5, 2.6e5, count),
        rng.uniform(0.2, 1.2, count),
        rng.uniform(2, 50, count),
    )
    return [oracle.Point(*(float(v) for v in row)) for row in zip(*columns, strict=True)]


def ours(tire: MagicFormula, where: list[oracle.Point]) -> jax.Array:
    kappa, alpha, gamma, Fz, pressure, lmu, V = np.array(where).T
    # our slip angle is positive to the other side
    force = tire.forces(kappa, -alpha, Fz, lmu, V, camber=gamma, pressure=pressure)
    moment = tire.moments(kappa, -alpha, Fz, lmu, V, camber=gamma, pressure=pressure)
    return jnp.stack([force.F_x, force.F_y, moment.M_x, moment.M_y, moment.M_z], axis=1)


def naive(tire: MagicFormula, p: oracle.Coefficients, where: list[oracle.Point]) -> np.ndarray:
    if tire.form == "MF6.1":
        return np.array([oracle.mf61(p, at) for at in where])
    return np.array([oracle.mf52(p, at, tire.combination == "ellipse") for at in where])


@pytest.mark.parametrize(
    "file",
    [
        "packaged",
        "passenger_205_60R15_mf61.tir",
        "sedan_245_40R18_pac2002.tir",
        "truck_335_65R22.5_mf5.tir",
    ],
)
def test_files_agree_with_the_oracle(file: str, request: pytest.FixtureRequest) -> None:
    if file == "packaged":
        path = PASSENGER
    else:
        folder: Path = request.getfixturevalue("shared_data")
        path = folder / "tires" / file
    tire, p = load_tir(path, friction_as="factor"), oracle.coefficients(path)
    where = points(p["FNOMIN"], 400, seed=1)
    # the oracle's arccos costs the ellipse half of its digits near pure slip
    np.testing.assert_allclose(ours(tire, where), naive(tire, p, where), rtol=1e-9, atol=1e-6)


def test_the_packaged_tire_is_the_shared_one(shared_data: Path) -> None:
    packaged = load_tir(PASSENGER)
    original = load_tir(shared_data / "tires" / "passenger_205_60R15_mf61.tir")
    assert packaged.coefficients == original.coefficients


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("form", "combination"), [("MF6.1", "weighting"), ("MF5.2", "weighting"), ("PAC2002", "ellipse")]
)
def test_every_coefficient_enters_as_in_the_oracle(form: str, combination: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    start = oracle.coefficients(PASSENGER)
    p = oracle.Coefficients()
    for name in DEFAULTS:
        typical = start[name]
        spread = 0.15 * abs(typical) if typical else 0.02
        p[name] = float(typical + rng.uniform(-spread, spread))
    p["PKY4"] = 1.9 if form == "MF6.1" else 2.0
    p["NOMPRES"] = 2.1e5
    p["LONGVL"], p["VXLOW"] = 16.0, 1.0
    if form != "MF6.1":
        # what 5.2 does not have
        for name in DEFAULTS:
            absent = ("RBX3", "RBY4", "PEY5", "PKY5", "PPMX1", "QDZ10", "QDZ11", "LKZC")
            if name.startswith(("PPX", "PPY", "PPZ")) or name in absent:
                p[name] = DEFAULTS[name]
    tire = MagicFormula(
        {name: jnp.asarray(value) for name, value in p.items()}, form=form, combination=combination
    )
    where = points(p["FNOMIN"], 100, seed)
    np.testing.assert_allclose(ours(tire, where), naive(tire, p, where), rtol=1e-8, atol=1e-5)


def test_every_coefficient_matters_somewhere() -> None:
    start = oracle.coefficients(PASSENGER)
    p = {name: float(start[name] or 0.02) for name in DEFAULTS} | {"PKY4": 1.9, "NOMPRES": 2.1e5}
    where = points(p["FNOMIN"], 20, seed=3)

    @jax.jit
    def answers(leaves: dict[str, jax.Array]) -> jax.Array:
        results = []
        for form, combination, relaxation in (
            ("MF6.1", "weighting", "polynomial"),
            ("MF5.2", "ellipse", "carcass"),
        ):
            tire = MagicFormula(leaves, form=form, combination=combination, relaxation=relaxation)
            pressed = tire.relaxation_lengths(5000.0, camber=0.1, pressure=2.3e5)
            slow = jnp.stack(tire.moments(0.02, 0.05, 4000.0, 0.8, 0.7))
            results += [ours(tire, where).ravel(), jnp.stack(pressed), slow]
        return jnp.concatenate(results)

    before = answers(p)
    # LMUX and LMUY are replaced by the friction asked for; INFLPRES is the default of an argument given here
    replaced = {"LMUX", "LMUY"}
    idle = [
        name
        for name in DEFAULTS
        if name not in replaced and np.array_equal(answers(p | {name: p[name] * 1.1}), before)
    ]
    assert idle == []
