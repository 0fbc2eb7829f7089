"""The standard Magic Formula against points worked by hand from the coefficients.

The packaged tire (passenger_205_60r15.tir): F_z0 = 4000 N, R_0 = 0.3135 m, ISO-W coefficients.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.tires import MagicFormula, linear_stiffness, load_tir
from roadstate.tires.mf_build import PASSENGER

V = 20.0


@pytest.fixture(scope="module")
def measured() -> MagicFormula:
    """As the file has it; friction is a factor."""
    return load_tir(PASSENGER, friction_as="factor")


@pytest.fixture(scope="module")
def symmetric() -> MagicFormula:
    """Without shifts; friction is a factor."""
    return load_tir(PASSENGER, symmetric=True, friction_as="factor")


def without(tire: MagicFormula, *names: str) -> MagicFormula:
    coefficients = {k: jnp.zeros_like(v) if k in names else v for k, v in tire.coefficients.items()}
    return eqx.tree_at(lambda t: t.coefficients, tire, coefficients)


def test_zero_slip_leaves_the_vertical_shift(measured: MagicFormula) -> None:
    # S_Vx = F_z p_Vx1 = 4000·2.20283e-5; S_Vy = F_z p_Vy1 = 4000·(−0.00661); at F_z0 λ' = 1, dfz = 0
    tire = without(measured, "PHX1", "PHX2", "PHY1", "PHY2")
    force = tire.forces(0.0, 0.0, 4000.0, 1.0, V)
    assert force.F_x == pytest.approx(0.0881132, rel=1e-6)
    assert force.F_y == pytest.approx(-26.44, rel=1e-6)
    # half the friction scales it by λ' = 10·0.5/(1 + 9·0.5) = 0.909091 (4.E8)
    assert tire.forces(0.0, 0.0, 4000.0, 0.5, V).F_y == pytest.approx(-26.44 * 0.9090909, rel=1e-6)


def test_horizontal_shift_acts_like_slip(measured: MagicFormula) -> None:
    # S_Hx = p_Hx1 = 2.1615e-4 at dfz = 0: F_x(0) ≈ K_xκ S_Hx + S_Vx = 86748·2.1615e-4 + 0.088 = 18.84 N
    assert measured.forces(0.0, 0.0, 4000.0, 1.0, V).F_x == pytest.approx(18.84, abs=0.01)
    # the force without S_V vanishes at κ = −S_Hx
    at_shift = measured.forces(-2.1615e-4, 0.0, 4000.0, 1.0, V).F_x
    assert at_shift == pytest.approx(0.0881132, rel=1e-6)


def test_peak_is_friction_times_load(symmetric: MagicFormula) -> None:
    # D_x = (p_Dx1 + p_Dx2 dfz) F_z: 1.0422·4000 = 4168.8; (1.0422 − 0.5·0.08285)·6000 = 6004.65
    # D_y: 0.8785·4000 = 3514; (0.8785 − 0.03226)·6000 = 5077.44
    slip, angle = np.linspace(0, 0.5, 5001), np.linspace(0, 0.5, 5001)
    for load, D_x, D_y in ((4000.0, 4168.8, 3514.0), (6000.0, 6004.65, 5077.44)):
        assert np.max(symmetric.forces(slip, 0.0, load, 1.0, V).F_x) == pytest.approx(D_x, rel=1e-6)
        assert np.max(symmetric.forces(0.0, angle, load, 1.0, V).F_y) == pytest.approx(D_y, rel=1e-6)
        peak_x, peak_y = symmetric.peak_friction(load, 1.0)
        assert (peak_x * load, peak_y * load) == (pytest.approx(D_x), pytest.approx(D_y))


def test_slip_stiffness_and_its_load_sensitivity(symmetric: MagicFormula) -> None:
    # K_xκ = F_z (p_Kx1 + p_Kx2 dfz) exp(p_Kx3 dfz)
    #   4000 N: 4000·21.687 = 86748
    #   6000 N: 6000·(21.687 + 6.864)·exp(−0.2049) = 171306·0.814728 = 139567.9
    # K_yα = p_Ky1 F_z0 sin(p_Ky4 arctan(F_z/(F_z0 p_Ky2)))
    #   4000 N: 61296·sin(2.0005·0.527973) = 61296·0.870418 = 53353.1
    #   6000 N: arctan(1.5/1.715) = 0.718676; 61296·sin(1.437711) = 61296·0.991156 = 60753.9
    along, across = linear_stiffness(symmetric, np.array([4000.0, 6000.0]))
    np.testing.assert_allclose(along, [86748.0, 139567.9], rtol=2e-6)
    np.testing.assert_allclose(across, [53353.1, 60753.9], rtol=2e-5)


def test_pressure_changes_stiffness_and_grip(symmetric: MagicFormula) -> None:
    # dpi = 0.15: K_xκ × 1 + p_px1 dpi + p_px2 dpi² = 1 − 0.052275 + 0.0085104 = 0.9562354
    #             μ_x × 1 + p_px3 dpi + p_px4 dpi² = 1 − 0.0144045 + 0.00146655 = 0.98706205
    soft = jax.grad(lambda k: symmetric.forces(k, 0.0, 4000.0, 1.0, V, pressure=2.3e5).F_x)(0.0)
    assert soft == pytest.approx(86748 * 0.9562354, rel=1e-6)
    peak_x, _ = symmetric.peak_friction(4000.0, 1.0, pressure=2.3e5)
    assert peak_x == pytest.approx(1.0422 * 0.98706205, rel=1e-8)


def test_camber_thrust(symmetric: MagicFormula) -> None:
    # ∂F_y/∂γ at zero slip is K_yγ0 = F_z p_Ky6 = 4000·(−0.8987) (4.E30): a top leaning right pulls right
    slope = jax.grad(lambda g: symmetric.forces(0.0, 0.0, 4000.0, 1.0, V, camber=g).F_y)(0.0)
    assert slope == pytest.approx(-3594.8, rel=1e-6)


def test_aligning_moment_at_small_slip(symmetric: MagicFormula) -> None:
    # t_0 = R_0 q_Dz1 = 0.3135·0.09068 = 0.0284282 m at F_z0; ∂M_z/∂α = −t_0 K_yα = −0.0284282·53353.1
    slope = jax.grad(lambda a: symmetric.moments(0.0, a, 4000.0, 1.0, V).M_z)(0.0)
    assert slope == pytest.approx(-1516.73, rel=1e-4)


def test_aligning_moment_turns_round_in_reverse(measured: MagicFormula) -> None:
    forward = measured.moments(0.02, 0.05, 4000.0, 1.0, V)
    # κ = −0.02 in reverse drives as +0.02 does forwards
    backward = measured.moments(-0.02, 0.05, 4000.0, 1.0, -V)
    assert forward.M_z < 0 < backward.M_z
    assert backward.M_z == -forward.M_z
    assert backward.M_y == -forward.M_y
    assert backward.M_x == forward.M_x


def test_rolling_resistance(symmetric: MagicFormula) -> None:
    # at F_z0 and p_0, V = V_0: −R_0 F_z0 (q_sy1 + q_sy3 + q_sy4) = −1254·(0.00702 + 0.001515 + 8.514e-5)
    assert symmetric.moments(0.0, 0.0, 4000.0, 1.0, 16.7).M_y == pytest.approx(-10.8096, rel=1e-4)
    assert symmetric.moments(0.0, 0.0, 4000.0, 1.0, 0.0).M_y == 0


def test_relaxation_lengths_from_the_polynomial(measured: MagicFormula) -> None:
    # σ_κ = p_Tx1 R_0 = 1.98·0.3135; σ_α = p_Ty1 sin(2 arctan(1/1.8)) R_0 = 1.8·0.849057·0.3135
    lengths = measured.relaxation_lengths(4000.0)
    assert lengths.longitudinal == pytest.approx(0.62073, rel=1e-6)
    assert lengths.lateral == pytest.approx(0.479123, rel=1e-5)
    assert measured.relaxation_lengths(6000.0).lateral > lengths.lateral


def test_relaxation_lengths_from_the_carcass(measured: MagicFormula) -> None:
    stiff = {"LONGITUDINAL_STIFFNESS": 3e5, "LATERAL_STIFFNESS": 1e5, "PCFX1": 0.2, "PCFY3": 0.5}
    coefficients = measured.coefficients | {k: jnp.asarray(v) for k, v in stiff.items()}
    tire = MagicFormula(coefficients, relaxation="carcass")
    # 6000 N: K_xκ/(3e5·1.1); 4000 N at 2.3 bar: K_yα/(1e5·(1 + 0.5·0.15))
    assert tire.relaxation_lengths(6000.0).longitudinal == pytest.approx(139567.9 / 3.3e5, rel=1e-5)
    plain = tire.relaxation_lengths(4000.0).lateral
    assert plain == pytest.approx(53353.1 / 1e5, rel=1e-5)
    assert tire.relaxation_lengths(4000.0, pressure=2.3e5).lateral != plain
    assert MagicFormula(coefficients).relaxation_lengths(4000.0) == (0, 0)


def test_friction_is_the_peak_at_the_nominal_load() -> None:
    tire = load_tir(PASSENGER, symmetric=True)
    sweep = np.linspace(0, 1, 20001)
    for mu in (0.1, 0.4, 1.0):
        assert np.max(tire.forces(sweep, 0.0, 4000.0, mu, V).F_x) == pytest.approx(mu * 4000, rel=1e-6)
        assert np.max(tire.forces(0.0, sweep, 4000.0, mu, V).F_y) == pytest.approx(mu * 4000, rel=1e-6)
        np.testing.assert_allclose(tire.peak_friction(4000.0, mu), mu, rtol=1e-9)
    # load sensitivity stays the file's: 6000 N takes 0.5·0.08285/1.0422 off the longitudinal peak
    assert tire.peak_friction(6000.0, 0.8)[0] == pytest.approx(0.8 * (1 - 0.5 * 0.08285 / 1.0422))


def test_friction_keeps_the_slip_stiffness_unless_told_otherwise() -> None:
    keeps = load_tir(PASSENGER, symmetric=True)
    scales = load_tir(PASSENGER, symmetric=True, stiffness_follows_friction=True)
    slippery, dry = linear_stiffness(keeps, 4000.0, 0.2), linear_stiffness(keeps, 4000.0, 1.0)
    np.testing.assert_allclose(slippery, dry, rtol=1e-12)
    np.testing.assert_allclose(
        linear_stiffness(scales, 4000.0, 0.2), 0.2 * np.stack(linear_stiffness(scales, 4000.0, 1.0))
    )


def test_shape_factor_below_one_lowers_the_peak_that_is_reached(measured: MagicFormula) -> None:
    blunt = eqx.tree_at(lambda t: t.coefficients["PCY1"], measured, jnp.asarray(0.6))
    # sin(0.6·π/2) = 0.809017
    assert blunt.peak_friction(4000.0, 1.0)[1] == pytest.approx(0.8785 * 0.809017, rel=1e-6)


def test_mirrored_tire_is_the_mirror_image(measured: MagicFormula) -> None:
    other = load_tir(PASSENGER, friction_as="factor", side="right")
    assert other.mirrored
    assert not load_tir(PASSENGER, side="left").mirrored
    a = measured.forces(0.05, 0.04, 5000.0, 0.9, V, camber=0.03)
    b = other.forces(0.05, -0.04, 5000.0, 0.9, V, camber=-0.03)
    np.testing.assert_allclose((b.F_x, b.F_y), (a.F_x, -a.F_y), rtol=1e-12)
    m = measured.moments(0.05, 0.04, 5000.0, 0.9, V, camber=0.03)
    n = other.moments(0.05, -0.04, 5000.0, 0.9, V, camber=-0.03)
    np.testing.assert_allclose((n.M_x, n.M_y, n.M_z), (-m.M_x, m.M_y, -m.M_z), rtol=1e-12)


def test_symmetric_tire_is_its_own_mirror_image_with_camber(symmetric: MagicFormula) -> None:
    rng = np.random.default_rng(1)
    slip, angle, camber = rng.uniform(-0.3, 0.3, (3, 200))
    load, pressure = rng.uniform(500, 9000, 200), rng.uniform(1.7e5, 2.4e5, 200)
    a = symmetric.forces(slip, angle, load, 0.9, V, camber=camber, pressure=pressure)
    b = symmetric.forces(slip, -angle, load, 0.9, V, camber=-camber, pressure=pressure)
    np.testing.assert_allclose(np.stack(b), np.stack([a.F_x, -a.F_y]), rtol=1e-9, atol=1e-8)
    m = symmetric.moments(slip, angle, load, 0.9, V, camber=camber, pressure=pressure)
    n = symmetric.moments(slip, -angle, load, 0.9, V, camber=-camber, pressure=pressure)
    np.testing.assert_allclose(np.stack(n), np.stack([-m.M_x, m.M_y, -m.M_z]), rtol=1e-9, atol=1e-8)


def test_ply_steer_needs_rolling(measured: MagicFormula) -> None:
    rest, slow, fast = (measured.forces(0.0, 0.0, 4000.0, 1.0, v) for v in (0.0, 0.5, 1.0))
    assert np.all(np.abs(np.stack(rest)) < 1e-9)
    assert 0 < abs(slow.F_y) < abs(fast.F_y)
    assert fast == measured.forces(0.0, 0.0, 4000.0, 1.0, 60.0)


def test_ellipse_pulls_a_locked_wheel_nearly_against_its_sliding() -> None:
    tire = load_tir(PASSENGER, symmetric=True, combination="ellipse")
    # beyond the peak the pure forces have fallen unequally, which the ellipse of the peaks does not know
    for angle in (0.1, 0.5, 1.0, 1.4):
        force = tire.forces(-1.0, angle, 4000.0, 0.8, V)
        assert np.arctan2(force.F_y, -force.F_x) == pytest.approx(angle, abs=np.radians(8))


def test_weighting_pulls_a_locked_wheel_nearly_against_its_sliding(symmetric: MagicFormula) -> None:
    # the cosine weighting knows no direction of sliding: at the friction of the file it is within 10°
    angle = np.linspace(-1.5, 1.5, 301)
    force = symmetric.forces(-1.0, angle, 4000.0, 1.0, V)
    assert np.max(np.abs(np.arctan2(force.F_y, -force.F_x) - angle)) < np.radians(10)


def test_tiny_loads_keep_the_ratio_of_force_to_load(symmetric: MagicFormula) -> None:
    per_load = [float(symmetric.forces(0.05, 0.03, F_z, 1.0, V).F_x) / F_z for F_z in (1e-6, 1e-3, 0.3)]
    np.testing.assert_allclose(per_load, per_load[0], rtol=1e-4)
    grip = jax.grad(lambda F_z: symmetric.forces(0.5, 0.0, F_z, 1.0, V).F_x)
    assert 0 < grip(1e-9) < 2


@pytest.mark.parametrize("moment", ["M_x", "M_y", "M_z"])
def test_moments_have_finite_slopes_where_formulas_break(measured: MagicFormula, moment: str) -> None:
    corners = jnp.array(
        [
            (0, 0, 4000, 1, 20),
            (0, 0, 0, 1, 0),
            (-1, 1.6, 4000, 1, 0),
            (1e3, 0, 4000, 0, 20),
            (0, 0, -1, 1, 20),
        ],
        dtype=float,
    )
    slopes = jax.vmap(jax.jacrev(lambda p: getattr(measured.moments(*p), moment)))(corners)
    assert np.all(np.isfinite(slopes))


def test_moments_vanish_without_load(measured: MagicFormula) -> None:
    assert np.all(np.stack(measured.moments(0.1, 0.1, 0.0, 1.0, V, camber=0.1)) == 0)
