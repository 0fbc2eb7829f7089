"""How a wheel stands on the road, and the tire's force there, down to standstill."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.sim.plant.vectors import cross, dot, settled, to_body, to_world, unit
from roadstate.tires.base import as_leaf
from roadstate.tires.magic_formula import MagicFormula
from roadstate.tires.smooth import Numbers, safe_hypot

# m/s of the wheel below which damping takes the place of the slip's own, and how its largest is scaled
_SLOW = 2.5
# what the transient slip cannot exceed: the force is that of full sliding long before
_LARGEST_SLIP = 2.0
# slip (of the stiffness' order) under which the secant of the force is its slope
_TINY = 1e-4


class Ground(NamedTuple):
    """The road under N tires, (N,) each or (3, N) along the body's axes.

    Attributes:
        normal: of the road.
        height: of the tire's centre over the road's tangent plane, m.
        friction: peak friction coefficient.
    """

    normal: Numbers
    height: Numbers
    friction: Numbers


class Frame(NamedTuple):
    """The contacts' frames, (3, N) along the body's axes: along the wheel, across it, normal to the road.

    Attributes:
        x, y, normal: unit vectors.
        axis: of the wheel, to the left.
        arm: from the wheel's centre to the contact, m; of a dual tire, which is beside it, too.
        loaded_radius: (N,) m.
        camber: (N,) rad.
    """

    x: Numbers
    y: Numbers
    normal: Numbers
    axis: Numbers
    arm: Numbers
    loaded_radius: Numbers
    camber: Numbers


class Contact(NamedTuple):
    """The tires' state of force; (N,) unless said otherwise.

    Attributes:
        force_x, force_y, load: N.
        force: (3, N) the same along the body's axes, N.
        moment: (3, N) about the wheel's centre along the body's axes, N·m.
        velocity_x, velocity_y, velocity_z: of the contact without the wheel's spin, m/s.
        effective_radius: m.
        slip_growth, slip_decay: (2, N), 1/s: d(κ', tan α')/dt = growth − decay · (κ', tan α').
    """

    force_x: Numbers
    force_y: Numbers
    load: Numbers
    force: Numbers
    moment: Numbers
    velocity_x: Numbers
    velocity_y: Numbers
    velocity_z: Numbers
    effective_radius: Numbers
    slip_growth: Numbers
    slip_decay: Numbers


def ground(road: Any, position: Numbers, R: Numbers, place: Numbers, centres: Numbers, under: Any) -> Ground:
    """The road under the tires.

    Args:
        road: with ``at(s, d)``.
        position: (3,) of the CG in the world, m.
        R: (3, 3) body to world.
        place: (2,) s and d of the CG.
        centres: (3, N) of the tires seen from the CG along the body's axes, m.
        under: the road's point at ``place``.
    """
    offset = to_world(R, centres)
    cos, sin = jnp.cos(under.heading), jnp.sin(under.heading)
    ahead, aside = offset[0] * cos + offset[1] * sin, offset[1] * cos - offset[0] * sin
    # on a centreline of constant curvature, exact to the third order of the offset over its radius
    shrink = jnp.maximum(1 - under.curvature * (place[1] + aside), 0.1)
    along = ahead / shrink
    s, d = place[0] + along, place[1] + aside - 0.5 * under.curvature * ahead * along
    return _tangent_plane(road.at(s, d), d, position[2] + offset[2], R)


def _tangent_plane(point: Any, d: Numbers, height: Numbers, R: Numbers) -> Ground:
    cos, sin = jnp.cos(point.heading), jnp.sin(point.heading)
    along = point.dz_ds / jnp.maximum(1 - point.curvature * d, 0.1)
    slope_x, slope_y = along * cos - point.dz_dd * sin, along * sin + point.dz_dd * cos
    upright = 1 / jnp.sqrt(1 + slope_x**2 + slope_y**2)
    normal = jnp.stack([-slope_x * upright, -slope_y * upright, upright])
    return Ground(to_body(R, normal), upright * (height - point.z), point.friction)


def frames(axis: Float[Array, "3 N"], under: Ground, beside: Numbers | float = 0.0) -> Frame:
    """The contacts' frames.

    Args:
        axis: (3, N) of the tires, along the body's axes.
        under: the road under them.
        beside: (N,) places of the tires along their axes, seen from the wheels' centres, m.
    """
    lean = dot(axis, under.normal)
    upright = jnp.sqrt(1 - lean**2)
    x = unit(cross(axis, under.normal))
    radius = under.height / upright
    arm = -(under.normal - lean * axis) * (radius / upright) + beside * axis
    return Frame(x, cross(under.normal, x), under.normal, axis, arm, radius, jnp.arctan2(lean, upright))


class Tires(eqx.Module):
    """N tires on four wheels, with the Magic Formula and contacts that lag behind.

    Dual tires are two, side by side on one wheel: each has its own load, since axles lean and roads are not
    plane, and its own slip, since a car that turns moves the outer one faster while both spin alike.

    The transient slips κ' and tan α' follow σ d/dt(κ', tan α') = −V_s − |V_x|·(κ', tan α') with the sliding
    velocity V_s = (V_x − R_e ω, V_y), and the force is the Magic Formula's at them. Their σ are the tire's
    relaxation lengths times the slope of the force over that at zero slip, since it is the carcass'
    deflection F/C that lags, not the slip (Pacejka, 3rd ed., §7.2, §8.6); that slope is taken for a brush
    tire's with the same secant. At standstill the equation is that of a spring: a locked wheel holds the car
    where it stands, and one that stops sliding gives back no more than its carcass held.
    Below 2.5 m/s a damping force c V_s is added inside the formula's argument (§8.6), so that it fades with
    speed and never exceeds friction; there the aligning moment fades to none at standstill (the moment that
    resists turning on the spot is not modelled).

    F_x turns the wheel with the effective radius as its arm, so that the road only ever takes energy.

    Attributes:
        model: the Magic Formula.
        beside: (N,) places of the tires along the wheel's axis seen from its centre, m, positive to the left.
        radius: (N,) unloaded, m.
        stiffness: (N,) vertical, N/m.
        damping: (N,) vertical, N·s/m.
        nominal_deflection: (N,) m, at which the effective radius' terms are scaled.
        shortest: m, floor of σ.
        low_speed_damping: (N,) c at standstill, N·s/m.
        effective: (3,) B, D, F of R_e = R₀ − δ₀(D arctan(B δ/δ₀) + F δ/δ₀) (Pacejka, eq. 4.E: §4.3, A.3).
        wheel: of each tire, 0 to 3, in ascending order.
    """

    model: MagicFormula
    beside: Numbers = eqx.field(converter=as_leaf)
    radius: Numbers = eqx.field(converter=as_leaf)
    stiffness: Numbers = eqx.field(converter=as_leaf)
    damping: Numbers = eqx.field(converter=as_leaf)
    nominal_deflection: Numbers = eqx.field(converter=as_leaf)
    low_speed_damping: Numbers = eqx.field(converter=as_leaf)
    shortest: Numbers = eqx.field(converter=as_leaf)
    effective: Numbers = eqx.field(converter=as_leaf)
    wheel: tuple[int, ...] = eqx.field(static=True, default=(0, 1, 2, 3))

    def of_wheels(self, values: Numbers) -> Numbers:
        """(…, N) values of the tires' wheels, from (…, 4)."""
        if len(self.wheel) == 4:
            return values
        return jnp.stack([values[..., i] for i in self.wheel], axis=-1)

    def summed(self, values: Numbers) -> Numbers:
        """(…, 4) sums over the tires of each wheel, from (…, N)."""
        if len(self.wheel) == 4:
            return values
        tires = [[k for k, i in enumerate(self.wheel) if i == wheel] for wheel in range(4)]
        return jnp.stack([sum(values[..., k] for k in some) for some in tires], axis=-1)

    def mean(self, values: Numbers) -> Numbers:
        """(…, 4) means over the tires of each wheel, from (…, N)."""
        if len(self.wheel) == 4:
            return values
        return self.summed(values) / self.summed(jnp.ones_like(values))

    def effective_radius(self, deflection: Numbers) -> Numbers:
        """R_e (N,) at a vertical deflection, m."""
        share = deflection / self.nominal_deflection
        B, D, F = self.effective
        lost: Numbers = self.nominal_deflection * (D * jnp.arctan(B * share) + F * share)
        return self.radius - lost

    def energy(self, loaded_radius: Numbers) -> Numbers:
        """Stored by the vertical deflections, J."""
        deflection = jnp.maximum(self.radius - loaded_radius, 0)
        return jnp.sum(0.5 * self.stiffness * deflection**2)

    def contact(
        self, frame: Frame, velocity: Numbers, spin: Numbers, slip: Numbers, friction: Numbers
    ) -> Contact:
        """The forces and what the transient slips do next.

        Args:
            frame: of the contacts.
            velocity: (3, N) of the contacts without the wheels' spin, along the body's axes, m/s.
            spin: (N,) of the tires' wheels, rad/s.
            slip: (2, N) transient slips κ' and tan α'.
            friction: (N,) peak friction coefficients.
        """
        v_x, v_y, v_z = dot(velocity, frame.x), dot(velocity, frame.y), dot(velocity, frame.normal)
        pressed = self.radius - frame.loaded_radius
        deflection = jnp.maximum(pressed, 0)
        carried = self.stiffness * deflection - self.damping * v_z
        load = jnp.where(pressed > 0, jnp.maximum(carried, 0), 0)
        R_e = self.effective_radius(deflection)
        sliding = jnp.stack([R_e * spin - v_x, -v_y])

        load, camber, sliding, v_x, C = settled(
            load, frame.camber, sliding, v_x, jnp.stack(self.model.stiffnesses(load, camber=frame.camber))
        )
        slow = 0.5 * (1 + jnp.cos(jnp.pi * jnp.minimum(jnp.abs(v_x) / _SLOW, 1)))
        damped = slip + self.low_speed_damping * slow * sliding / C
        kappa, alpha = damped[0], jnp.arctan(damped[1])
        F_x, F_y = self.model.forces(kappa, alpha, load, friction, v_x, camber=camber)
        M_x, M_y, M_z = self.model.moments(kappa, alpha, load, friction, v_x, camber=camber)

        # at standstill the trail would be a moment that no deflection answers for: it can shake the steering
        M_z = M_z * (1 - slow)

        elastic = C * damped
        linear = safe_hypot(elastic[0], elastic[1])
        actual = safe_hypot(F_x, F_y)
        secant = jnp.where(linear > _TINY * C[0], actual / jnp.maximum(linear, _TINY * C[0]), 1.0)
        lengths = jnp.stack(self.model.relaxation_lengths(load, camber=camber))
        sigma = jnp.maximum(lengths * _slope(secant), self.shortest)

        F_x, F_y, load, M_x, M_y, M_z, sigma = settled(F_x, F_y, load, M_x, M_y, M_z, sigma)
        force = F_x * frame.x + F_y * frame.y + load * frame.normal
        about_axis = M_y + (frame.loaded_radius - R_e) * F_x
        moment = cross(frame.arm, force) + M_x * frame.x + M_z * frame.normal + about_axis * frame.axis
        return Contact(
            F_x, F_y, load, force, moment, v_x, v_y, v_z, R_e, sliding / sigma, jnp.abs(v_x) / sigma
        )


def _slope(secant: Numbers) -> Numbers:
    """Slope of a brush tire's force over that at zero slip, from the secant likewise: 0 where it slides.

    With θ from 0 to 1 the secant is 1 − θ + θ²/3 and the slope (1 − θ)² (Pacejka, 3rd ed., §3.2).
    """
    return (0.5 * (jnp.sqrt(jnp.clip(12 * secant - 3, 1.0, 9.0)) - 1)) ** 2


def limit_slip(slip: Float[Array, "2 N"]) -> Float[Array, "2 N"]:
    """Transient slips kept within a circle: a wheel that spins at standstill has no end to them."""
    return slip / jnp.maximum(safe_hypot(slip[0], slip[1]) / _LARGEST_SLIP, 1)


def relax_slip(slip: Numbers, growth: Numbers, decay: Numbers, dt: Numbers) -> Numbers:
    """(2, N) transient slips after Δt with growth and decay held: exact, stable for any step."""
    rate = jnp.maximum(decay, 1e-12)
    fading = -jnp.expm1(-rate * dt)
    return slip + (growth / rate - slip) * fading
