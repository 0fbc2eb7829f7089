"""The standard Magic Formula tire: MF 6.1, MF 5.2 and PAC2002."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.base import Fit, TireForce, TireModel, as_leaf, parameter
from roadstate.tires.mf_combined import Combined, highest, on_ellipse, weighted, within_circle
from roadstate.tires.mf_moment import TireMoments, aligning, overturning, rolling
from roadstate.tires.mf_pure import Operating, Pure, lateral, longitudinal, operate
from roadstate.tires.slip import travel_direction
from roadstate.tires.smooth import Numbers

Form = Literal["MF6.1", "MF5.2", "PAC2002"]
Combination = Literal["weighting", "ellipse"]
Relaxation = Literal["polynomial", "carcass", "none"]


class RelaxationLengths(NamedTuple):
    """Distances (m) over which the forces follow their slip.

    Attributes:
        longitudinal: σ_κ.
        lateral: σ_α.
    """

    longitudinal: Numbers
    lateral: Numbers


class _Evaluation(NamedTuple):
    # in the direction of travel: braking has a negative slip, and F_x turns with ``direction``
    operating: Operating
    x: Pure
    y: Pure
    combined: Combined
    direction: Numbers


def _leaves(coefficients: Mapping[str, Any]) -> dict[str, Numbers]:
    return {name: as_leaf(value) for name, value in coefficients.items()}


class MagicFormula(TireModel):
    """The Magic Formula of the tire property files, pure and combined (Pacejka, 3rd ed., §4.3.2).

    Sensitive to load, camber and pressure. Axes are this package's: a positive slip angle gives a positive
    lateral force, x forward, y left, z up; the files' own (ISO-W, where it gives a negative one) stay inside.
    Load, camber, pressure and slip outside the file's ranges are extrapolated, not clipped. Not modelled:
    turn slip (every ζ is 1), friction that decays with sliding speed (LMUV is 0), the loaded radius.

    Friction replaces the file's LMUX and LMUY and leaves the slip stiffness as it is. With the default
    references μ is the peak that either pure force reaches at the nominal load, without camber and at nominal
    pressure; load and camber then move it as the file says (:meth:`peak_friction`).

    Build one with :func:`roadstate.tires.load_tir`.

    Attributes:
        coefficients: every name of :data:`roadstate.tires.mf_coefficients.DEFAULTS` → value, SI.
        reference_x, reference_y: friction at which LMUX and LMUY would be 1.
        form: whose equations hold.
        combination: how the pure forces combine: weighting functions, or the friction ellipse.
        relaxation: whether the relaxation lengths come from a polynomial in load, or from slip stiffness over
            carcass stiffness.
        mirrored: the tire is mounted on the other side than it was measured on.
        stiffness_follows_friction: scale the slip stiffness along with friction.
        bounded: keep the force within the pure peaks, whatever camber and shifts add
            (:func:`roadstate.tires.mf_combined.within_circle`); beyond the standard.
    """

    name = "magic_formula"
    summary = "MF 6.1, MF 5.2 or PAC2002 from a .tir file"
    fitted: ClassVar[Mapping[str, Fit]] = {}
    # cosine weighting is not bounded by a circle, and load moves the peak
    within_friction_circle = False

    coefficients: dict[str, Numbers] = eqx.field(converter=_leaves)
    reference_x: Numbers = parameter(1.0)
    reference_y: Numbers = parameter(1.0)
    form: Form = eqx.field(default="MF6.1", static=True)
    combination: Combination = eqx.field(default="weighting", static=True)
    relaxation: Relaxation = eqx.field(default="none", static=True)
    mirrored: bool = eqx.field(default=False, static=True)
    stiffness_follows_friction: bool = eqx.field(default=False, static=True)
    bounded: bool = eqx.field(default=False, static=True)

    @classmethod
    def default(cls) -> Self:
        """The 205/60R15 passenger tire that comes with the package, made symmetric."""
        from roadstate.tires.mf_build import PASSENGER, load_tir

        tire = load_tir(PASSENGER, symmetric=True)
        assert isinstance(tire, cls)
        return tire

    def forces(
        self,
        slip: ArrayLike,
        slip_angle: ArrayLike,
        load: ArrayLike,
        friction: ArrayLike,
        speed: ArrayLike,
        *,
        camber: ArrayLike = 0.0,
        pressure: ArrayLike | None = None,
    ) -> TireForce:
        """As :meth:`TireModel.forces`, and:

        Args:
            camber: inclination γ, rad; positive when the wheel's top leans to the right.
            pressure: inflation pressure, Pa; the file's own by default.
        """
        e = self._evaluate(slip, slip_angle, load, friction, speed, camber, pressure)
        carried = e.operating.carried
        return TireForce(e.direction * carried * e.combined.F_x, self._side * carried * e.combined.F_y)

    def moments(
        self,
        slip: ArrayLike,
        slip_angle: ArrayLike,
        load: ArrayLike,
        friction: ArrayLike,
        speed: ArrayLike,
        *,
        camber: ArrayLike = 0.0,
        pressure: ArrayLike | None = None,
    ) -> TireMoments:
        """The steady moments at the contact centre, N·m.

        Args:
            slip, slip_angle, load, friction, speed, camber, pressure: as :meth:`forces`. In reverse the
                force trails in front of the wheel centre, which turns M_z round, and so does M_y.
        """
        e = self._evaluate(slip, slip_angle, load, friction, speed, camber, pressure)
        o, c, is_61 = e.operating, self.coefficients, self.form == "MF6.1"
        if is_61:
            upright = lateral(c, o._replace(gamma=jnp.zeros_like(o.gamma)), is_61).force()
        else:
            upright = e.y.force()
        along = e.direction * o.carried
        return TireMoments(
            M_x=self._side * o.carried * overturning(c, o, e.combined.F_y),
            M_y=along * rolling(c, o, e.combined.F_x, self._pressure(pressure)),
            M_z=self._side * along * aligning(c, o, e.x, e.y, e.combined, upright, is_61),
        )

    def peak_friction(
        self,
        load: ArrayLike,
        friction: ArrayLike,
        *,
        camber: ArrayLike = 0.0,
        pressure: ArrayLike | None = None,
    ) -> tuple[Numbers, Numbers]:
        """Largest |F_x|/F_z and |F_y|/F_z in pure slip, without the vertical shifts.

        Args:
            load, friction, camber, pressure: as :meth:`forces`.
        """
        e = self._evaluate(0.0, 0.0, load, friction, self.coefficients["VXLOW"], camber, pressure)
        load_kept = e.operating.load
        return e.x.D / load_kept * highest(e.x.C), e.y.D / load_kept * highest(e.y.C)

    def stiffnesses(
        self,
        load: ArrayLike,
        *,
        friction: ArrayLike | None = None,
        camber: ArrayLike = 0.0,
        pressure: ArrayLike | None = None,
    ) -> tuple[Numbers, Numbers]:
        """Slip stiffness C_κ (N) and cornering stiffness C_α (N/rad) at a load (4.E15, 4.E25).

        Args:
            load, camber, pressure: as :meth:`forces`.
            friction: likewise, where stiffness follows it; the reference by default.
        """
        mu = self.reference_x if friction is None else friction
        e = self._evaluate(0.0, 0.0, load, mu, self.coefficients["VXLOW"], camber, pressure)
        return e.x.K, -e.y.K

    def relaxation_lengths(
        self, load: ArrayLike, *, camber: ArrayLike = 0.0, pressure: ArrayLike | None = None
    ) -> RelaxationLengths:
        """Relaxation lengths σ_κ and σ_α at a load, m; zeros where the file has nothing to take them from.

        The polynomial is MF 5.2's, the quotient of stiffnesses 6.1's (Besselink et al., 2010, eqs. 17–20).

        Args:
            load, camber, pressure: as :meth:`forces`.
        """
        c = self.coefficients
        e = self._evaluate(0.0, 0.0, load, self.reference_x, c["VXLOW"], camber, pressure)
        o = e.operating
        if self.relaxation == "none":
            return RelaxationLengths(jnp.zeros_like(o.load), jnp.zeros_like(o.load))
        if self.relaxation == "carcass":
            return RelaxationLengths(
                jnp.abs(e.x.K)
                / (c["LONGITUDINAL_STIFFNESS"] * _quadratic(o.dfz, c["PCFX1"], c["PCFX2"]))
                / (1 + c["PCFX3"] * o.dpi),
                jnp.abs(e.y.K)
                / (c["LATERAL_STIFFNESS"] * _quadratic(o.dfz, c["PCFY1"], c["PCFY2"]))
                / (1 + c["PCFY3"] * o.dpi),
            )
        radius = c["UNLOADED_RADIUS"]
        longitudinal_length = (
            o.load
            / c["FNOMIN"]
            * radius
            * (c["PTX1"] + c["PTX2"] * o.dfz)
            * jnp.exp(-c["PTX3"] * o.dfz)
            * c["LSGKP"]
        )
        lateral_length = (
            c["PTY1"]
            * jnp.sin(2 * jnp.arctan(o.load / (c["PTY2"] * c["FNOMIN"] * c["LFZO"])))
            * (1 - c["PKY3"] * jnp.abs(o.gamma))
            * radius
            * c["LFZO"]
            * c["LSGAL"]
        )
        return RelaxationLengths(longitudinal_length, lateral_length)

    @property
    def _side(self) -> float:
        return -1.0 if self.mirrored else 1.0

    def _pressure(self, pressure: ArrayLike | None) -> Numbers:
        return self.coefficients["INFLPRES"] if pressure is None else jnp.asarray(pressure)

    def _evaluate(
        self,
        slip: ArrayLike,
        slip_angle: ArrayLike,
        load: ArrayLike,
        friction: ArrayLike,
        speed: ArrayLike,
        camber: ArrayLike,
        pressure: ArrayLike | None,
    ) -> _Evaluation:
        kappa, alpha, F_z, mu, v, gamma, p = jnp.broadcast_arrays(
            slip, slip_angle, load, friction, speed, camber, self._pressure(pressure)
        )
        c, is_61, direction = self.coefficients, self.form == "MF6.1", travel_direction(v)
        o = operate(
            c,
            is_61=is_61,
            slip=direction * kappa,
            alpha=-self._side * alpha,
            camber=self._side * gamma,
            load=F_z,
            pressure=p,
            friction=(mu / self.reference_x, mu / self.reference_y),
            speed=v,
        )
        x, y = longitudinal(c, o, is_61), lateral(c, o, is_61)
        if self.stiffness_follows_friction:
            x, y = _scale_stiffness(x, o.friction_x), _scale_stiffness(y, o.friction_y)
        combined = weighted(c, o, x, y) if self.combination == "weighting" else on_ellipse(o, x, y, is_61)
        if self.bounded:
            combined = within_circle(o, x, y, combined)
        return _Evaluation(o, x, y, combined, direction)


def _quadratic(x: Numbers, a: Numbers, b: Numbers) -> Numbers:
    return 1 + a * x + b * x**2


def _scale_stiffness(pure: Pure, factor: Numbers) -> Pure:
    return pure._replace(K=pure.K * factor, B=pure.B * factor)
