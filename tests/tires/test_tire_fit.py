"""Fitting one tire to another, and the curves of a tire."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core import InputError
from roadstate.tires import (
    Brush,
    Dugoff,
    Linear,
    MagicFormula,
    MagicFormulaSimple,
    ModifiedDugoff,
    NormalizedDugoff,
    TireModel,
    curves,
    fit_tire,
    linear_stiffness,
)

HIDDEN: list[TireModel] = [
    Dugoff(
        slip_stiffness=61e3, cornering_stiffness=47e3, slip_load_exponent=0.9, cornering_load_exponent=0.4
    ),
    Brush(slip_stiffness=61e3, cornering_stiffness=47e3, slip_load_exponent=0.9, cornering_load_exponent=0.4),
    NormalizedDugoff(slip_stiffness=15.0, cornering_stiffness=9.0),
    ModifiedDugoff(slip_stiffness=61e3, cornering_stiffness=47e3, speed_influence=0.03),
    MagicFormulaSimple(B_x=10.0, C_x=1.5, E_x=0.3, d_x=1.1, B_y=8.0, C_y=1.25, E_y=-0.3, d_y=0.9),
]


@pytest.mark.parametrize("hidden", HIDDEN, ids=lambda tire: tire.name)
def test_a_model_fitted_to_its_own_kind_finds_the_parameters(hidden: TireModel) -> None:
    result = fit_tire(type(hidden), hidden, loads=(2500.0, 5500.0), friction=(0.5, 0.9))
    assert result.converged
    for name in hidden.fitted:
        np.testing.assert_allclose(getattr(result.model, name), getattr(hidden, name), rtol=1e-4, atol=1e-6)
    assert max(m.largest_percent for m in result.misfit.values()) < 1e-2


def test_misfit_counts_what_the_fitted_model_leaves() -> None:
    target = MagicFormula.default()
    result = fit_tire(Brush, target, loads=(4000.0,), points=31)
    angle = np.linspace(-0.2, 0.2, 31)
    error = (
        result.model.forces(0.0, angle, 4000.0, 1.0, 20.0).F_y
        - target.forces(0.0, angle, 4000.0, 1.0, 20.0).F_y
    )
    misfit = result.misfit["pure_F_y"]
    assert misfit.rms == pytest.approx(float(np.sqrt(np.mean(error**2))))
    assert misfit.largest == pytest.approx(float(np.max(np.abs(error))))
    # the target's peak is μF_z = 4000 N
    assert misfit.rms_percent == pytest.approx(misfit.rms / 40, rel=1e-3)


def test_fit_beats_the_template_and_any_nudge() -> None:
    target = MagicFormula.default()

    def cost(model: TireModel) -> float:
        total = 0.0
        for load in (2000.0, 4000.0, 6000.0):
            for slip, angle in ((np.linspace(-0.15, 0.15, 31), 0.0), (0.0, np.linspace(-0.2, 0.2, 31))):
                got = np.stack(model.forces(slip, angle, load, 1.0, 20.0))
                want = np.stack(target.forces(slip, angle, load, 1.0, 20.0))
                total += float(np.mean(((got - want) / load) ** 2))
        return total

    assert cost(fit_tire(Dugoff, target, loads=(2000.0, 4000.0, 6000.0)).model) < 0.7 * cost(Dugoff())


def test_known_quality_against_the_magic_formula() -> None:
    target = MagicFormula.default()
    percent = {
        cls.name: fit_tire(cls, target).misfit["pure_F_y"].rms_percent
        for cls in (Dugoff, NormalizedDugoff, Brush, MagicFormulaSimple)
    }
    # measured; the order is what the models' docstrings promise
    assert percent["brush"] < percent["dugoff"] < percent["normalized_dugoff"] < 15
    assert percent["brush"] < 4
    assert percent["magic_formula_simple"] < 6


def test_only_the_named_parameters_move() -> None:
    result = fit_tire(Dugoff, MagicFormula.default(), only=["slip_stiffness"])
    assert result.model.cornering_stiffness == Dugoff().cornering_stiffness
    assert result.model.slip_stiffness != Dugoff().slip_stiffness


def test_friction_can_be_matched_too() -> None:
    # a Dugoff whose μ is 0.8 of what it is asked for
    class Slippery(Dugoff):
        def forces(self, slip, slip_angle, load, friction, speed):  # type: ignore[no-untyped-def]
            return super().forces(slip, slip_angle, load, 0.8 * friction, speed)

    result = fit_tire(Dugoff, Slippery(), match_friction=True)
    assert result.friction_factor == pytest.approx(0.8, rel=1e-5)
    assert fit_tire(Dugoff, Slippery()).friction_factor == 1


def test_a_fitted_model_still_follows_the_precision_of_its_inputs() -> None:
    model = fit_tire(Linear, Dugoff(), largest_slip=0.01, largest_slip_angle=0.01).model
    assert model.forces(np.float32(0.1), np.float32(0.1), 4e3, 0.8, 20.0).F_x.dtype == np.float32


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"only": ["mass"]}, "'dugoff' cannot fit mass; it can fit slip_stiffness"),
        ({"loads": []}, "loads and frictions above zero"),
        ({"loads": [-1.0]}, "loads and frictions above zero"),
        ({"friction": [0.0]}, "loads and frictions above zero"),
        ({"largest_slip": 1.0}, "0 < largest_slip < 1"),
        ({"points": 2}, "at least 5 points"),
    ],
)
def test_impossible_fits_are_refused(options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        fit_tire(Dugoff, Brush(), **options)
    with pytest.raises(InputError, match="'magic_formula' has no parameters to fit"):
        fit_tire(MagicFormula, Brush())


def test_linear_stiffness_is_what_was_put_in() -> None:
    along, across = linear_stiffness(Dugoff(slip_stiffness=70e3, cornering_stiffness=40e3), [4000.0, 1000.0])
    np.testing.assert_allclose(along, 70e3)
    np.testing.assert_allclose(across, 40e3)


def test_curves_hold_what_they_say() -> None:
    tire = MagicFormula.default()
    c = curves(tire, [2000.0, 4000.0], friction=0.8, points=51)
    assert c["F_x"].shape == c["F_y"].shape == c["M_z"].shape == (2, 51)
    assert c["combined_F_x"].shape == c["combined_F_y"].shape == (2, 5, 51)
    i, j, k = 1, 3, 40
    force = tire.forces(c["slip"][k], c["combined_slip_angle"][j], c["load"][i], 0.8, 20.0)
    np.testing.assert_allclose((c["combined_F_x"][i, j, k], c["combined_F_y"][i, j, k]), force)
    np.testing.assert_allclose(c["F_y"][i, k], tire.forces(0.0, c["slip_angle"][k], 4000.0, 0.8, 20.0).F_y)
    assert c["peak_x"][1] == pytest.approx(0.8, rel=1e-2)
    assert c["relaxation_y"][1] == pytest.approx(0.479123, rel=1e-5)
    assert "M_z" not in curves(Dugoff(), [4000.0])
