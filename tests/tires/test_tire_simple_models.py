"""The models with a handful of parameters, against numbers worked by hand and limits of one another."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from roadstate.tires import (
    Brush,
    Dugoff,
    Linear,
    MagicFormulaSimple,
    ModifiedDugoff,
    NormalizedDugoff,
    TireModel,
    relax,
    relaxation_rate,
)

F_z, MU, V = 4000.0, 0.8, 20.0


def test_linear_by_hand() -> None:
    tire = Linear(slip_stiffness=80e3, cornering_stiffness=50e3, nominal_load=4e3)
    force = tire.forces(0.01, 0.02, 2000.0, 0.1, V)
    assert force.F_x == pytest.approx(80e3 * 0.5 * 0.01)
    assert force.F_y == pytest.approx(50e3 * 0.5 * 0.02)


def test_dugoff_by_hand() -> None:
    tire = Dugoff(slip_stiffness=80e3, cornering_stiffness=50e3)
    # κ = −0.01: σ_x = −0.01/0.99; |C σ| = 808.08 < μF_z/2 = 1600: linear
    assert tire.forces(-0.01, 0.0, F_z, MU, V).F_x == pytest.approx(-80e3 * 0.01 / 0.99)
    # κ = 0.25, tan α = 0.1: σ = (0.2, 0.08); C σ = (16000, 4000), |·| = 16492.42; λ = 3200/32984.85
    # f = λ(2 − λ) = 0.1846167; F = (2953.87, 738.47)
    force = tire.forces(0.25, np.arctan(0.1), F_z, MU, V)
    assert force.F_x == pytest.approx(2953.87, abs=0.01)
    assert force.F_y == pytest.approx(738.47, abs=0.01)


def test_below_half_the_limit_dugoff_does_not_see_friction() -> None:
    tire = Dugoff(slip_stiffness=80e3, cornering_stiffness=50e3)
    seen = jax.grad(lambda mu: tire.forces(0.015, 0.005, F_z, mu, V).F_x)
    assert seen(0.8) == 0
    assert jax.grad(lambda mu: tire.forces(0.1, 0.05, F_z, mu, V).F_x)(0.8) > 0


def test_braking_mirrors_driving_in_theoretical_slip() -> None:
    for tire in (Dugoff(), Brush(), NormalizedDugoff()):
        # σ_x = κ/(1 + κ): κ = 0.25 and κ = −1/6 are σ_x = ±0.2
        drive, brake = (tire.forces(kappa, 0.0, F_z, MU, V).F_x for kappa in (0.25, -1 / 6))
        assert drive == pytest.approx(-brake)


def test_modified_dugoff_loses_friction_with_sliding_speed() -> None:
    plain = Dugoff(slip_stiffness=80e3, cornering_stiffness=50e3)
    tire = ModifiedDugoff(slip_stiffness=80e3, cornering_stiffness=50e3, speed_influence=0.015)
    # κ = −0.5, α = 0: s = −0.5, factor 1 − 0.015·20·0.5 = 0.85 on λ
    reduced = tire.forces(-0.5, 0.0, F_z, MU, V).F_x
    assert reduced == pytest.approx(plain.forces(-0.5, 0.0, F_z, 0.85 * MU, V).F_x)
    assert tire.forces(-0.5, 0.0, F_z, MU, 0.0).F_x == pytest.approx(plain.forces(-0.5, 0.0, F_z, MU, V).F_x)
    # driving uses s = κ/(1 + κ) = 0.5 for κ = 1
    assert tire.forces(1.0, 0.0, F_z, MU, V).F_x == pytest.approx(
        plain.forces(1.0, 0.0, F_z, 0.85 * MU, V).F_x
    )
    # never below the bound, however fast
    assert tire.forces(-1.0, 0.0, F_z, MU, 1e4).F_x == pytest.approx(
        plain.forces(-1.0, 0.0, F_z, 0.1 * MU, V).F_x
    )


def test_normalized_dugoff_is_dugoff_with_stiffness_proportional_to_capacity() -> None:
    tire = NormalizedDugoff(slip_stiffness=20.0, cornering_stiffness=12.0)
    same = Dugoff(slip_stiffness=20 * MU * F_z, cornering_stiffness=12 * MU * F_z)
    for slip, angle in ((0.02, 0.01), (-0.3, 0.1), (0.4, -0.2)):
        a, b = tire.forces(slip, angle, F_z, MU, V), same.forces(slip, angle, F_z, MU, V)
        np.testing.assert_allclose(a, b, rtol=1e-12)
        unit = tire.normalized_forces(slip, angle, F_z)
        np.testing.assert_allclose(a, MU * np.stack(unit), rtol=1e-12)


def test_normalized_dugoff_as_printed_agrees_in_braking_and_not_in_driving() -> None:
    ours, printed = NormalizedDugoff(), NormalizedDugoff(as_printed=True)
    for slip in (-0.01, -0.2, -0.7):
        np.testing.assert_allclose(
            printed.forces(slip, 0.05, F_z, MU, V), ours.forces(slip, 0.05, F_z, MU, V), rtol=1e-12
        )
    # driving at κ = 0.25: s = 0.2; by hand with c = 22, 13: L = 0.8/(2·4.4) = 0.0909091, f = 0.1735537,
    # F_x = 0.8·4000·22·(0.2/1.2)·f = 2036.36
    assert printed.forces(0.25, 0.0, F_z, MU, V).F_x == pytest.approx(2036.36, abs=0.01)
    assert ours.forces(0.25, 0.0, F_z, MU, V).F_x != pytest.approx(2036.36, rel=0.1)


def test_isotropic_brush_is_the_cubic_of_the_textbook() -> None:
    tire = Brush(slip_stiffness=60e3, cornering_stiffness=60e3)
    for sigma in (0.01, 0.05, 0.1, 0.159, 0.2):
        psi = min(60e3 * sigma / (3 * MU * F_z), 1.0)
        expected = MU * F_z * (3 * psi - 3 * psi**2 + psi**3)
        force = tire.forces(0.0, np.arctan(sigma), F_z, MU, V)
        assert force.F_y == pytest.approx(expected, rel=1e-12)
        kappa = -sigma / (1 + sigma)
        assert tire.forces(kappa, 0.0, F_z, MU, V).F_x == pytest.approx(-expected, rel=1e-9)


def test_brush_sees_friction_at_once() -> None:
    tire = Brush()
    assert jax.grad(lambda mu: tire.forces(0.0, 0.01, F_z, mu, V).F_y)(0.8) > 1


@pytest.mark.parametrize(
    "tire",
    [
        Brush(),
        Dugoff(slip_stiffness=6e5, cornering_stiffness=6e5),
        NormalizedDugoff(slip_stiffness=200.0, cornering_stiffness=200.0),
    ],
    ids=lambda tire: tire.name,
)
@pytest.mark.parametrize("angle", [-1.2, -0.3, 0.0, 0.1, 0.8])
def test_a_locked_wheel_is_pulled_against_its_sliding(tire: TireModel, angle: float) -> None:
    # it slides with (1, −tan α)·v_x; the force is −μF_z along that
    force = tire.forces(-1.0, angle, F_z, MU, V)
    np.testing.assert_allclose(
        force, [-MU * F_z * np.cos(angle), MU * F_z * np.sin(angle)], atol=2e-3 * MU * F_z
    )


def test_dugoff_reaches_the_limit_along_its_stiffnesses() -> None:
    tire = Dugoff(slip_stiffness=80e3, cornering_stiffness=40e3)
    force = tire.forces(-1.0, 0.5, F_z, MU, V)
    assert np.hypot(*force) == pytest.approx(MU * F_z, rel=1e-3)
    assert force.F_y / -force.F_x == pytest.approx(0.5 * np.tan(0.5), rel=1e-9)


def test_magic_formula_simple_in_pure_slip() -> None:
    tire = MagicFormulaSimple(B_x=12.0, C_x=1.6, E_x=0.2, d_x=1.1, B_y=9.0, C_y=1.3, E_y=-0.5, d_y=1.0)

    def formula(x: float, B: float, C: float, D: float, E: float) -> float:
        return D * np.sin(C * np.arctan(B * x - E * (B * x - np.arctan(B * x))))

    # μ = 0.8 leaves the stiffness BCD alone: B becomes B/0.8
    assert tire.forces(-0.1, 0.0, F_z, 0.8, V).F_x == pytest.approx(
        formula(-0.1, 15.0, 1.6, 1.1 * 0.8 * F_z, 0.2)
    )
    # driving takes κ/(1 + κ)
    assert tire.forces(0.25, 0.0, F_z, 0.8, V).F_x == pytest.approx(
        formula(0.2, 15.0, 1.6, 1.1 * 0.8 * F_z, 0.2)
    )
    assert tire.forces(0.0, 0.07, F_z, 0.8, V).F_y == pytest.approx(
        formula(0.07, 11.25, 1.3, 0.8 * F_z, -0.5)
    )


def test_magic_formula_simple_stiffness_with_friction() -> None:
    keeps, scales = MagicFormulaSimple(), MagicFormulaSimple(stiffness_scales_with_friction=True)

    def stiffness(tire: TireModel, mu: float) -> float:
        return float(jax.grad(lambda k: tire.forces(k, 0.0, F_z, mu, V).F_x)(0.0))

    assert stiffness(keeps, 0.3) == pytest.approx(stiffness(keeps, 1.0))
    assert stiffness(scales, 0.3) == pytest.approx(0.3 * stiffness(scales, 1.0))
    assert stiffness(keeps, 1.0) == pytest.approx(13.5 * 1.6 * F_z)


def test_small_slips_superpose_in_similarity_but_not_as_printed() -> None:
    small = 1e-4
    both = MagicFormulaSimple().forces(small, small, F_z, MU, V)
    alone = MagicFormulaSimple().forces(small, 0.0, F_z, MU, V)
    assert float(both.F_x) == pytest.approx(float(alone.F_x), rel=1e-3)
    printed = MagicFormulaSimple(as_printed=True).forces(small, small, F_z, MU, V)
    assert float(printed.F_x) == pytest.approx(float(alone.F_x) / np.sqrt(2), rel=1e-3)


def test_similarity_stays_within_the_circle_when_both_peaks_are_one() -> None:
    slip, angle = np.meshgrid(np.linspace(-1, 3, 81), np.linspace(-1.4, 1.4, 81))
    for tire in (MagicFormulaSimple(), MagicFormulaSimple(as_printed=True)):
        assert np.max(np.hypot(*tire.forces(slip, angle, F_z, MU, V))) <= MU * F_z * (1 + 1e-12)


def test_relaxation_reaches_63_percent_after_its_length() -> None:
    # 20 m/s for 0.02 s are 0.4 m
    assert relax(0.0, 1000.0, 20.0, 0.4, 0.02) == pytest.approx(1000 * (1 - np.exp(-1)))
    assert relax(200.0, 1000.0, -20.0, 0.4, 0.02) == pytest.approx(1000 - 800 * np.exp(-1))
    assert relax(200.0, 1000.0, 0.0, 0.4, 1.0) == 200
    assert relax(200.0, 1000.0, 20.0, 0.0, 0.01) == 1000


def test_relaxation_rate_is_the_slope_of_the_exact_step() -> None:
    slope = jax.grad(lambda dt: relax(200.0, 1000.0, 20.0, 0.4, dt))(0.0)
    assert relaxation_rate(200.0, 1000.0, 20.0, 0.4) == pytest.approx(float(slope))
    assert relaxation_rate(200.0, 1000.0, 20.0, 0.4) == pytest.approx(20 / 0.4 * 800)
