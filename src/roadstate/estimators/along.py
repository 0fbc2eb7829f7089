"""Motion along the road: speed, slope, and what accelerometer, wheels, torques and satellites disagree by."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Literal, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.gaussian import Gaussian
from roadstate.estimators.air import Air
from roadstate.estimators.base import leaf
from roadstate.estimators.intake import WHEEL_SPEEDS
from roadstate.estimators.loading import Loading
from roadstate.estimators.pitch import Pitching
from roadstate.estimators.road import GradePrior
from roadstate.estimators.signals import way
from roadstate.estimators.slow_errors import LATE, WIND, slow_errors, slow_factor
from roadstate.estimators.tilted_plane import wander
from roadstate.estimators.undulation import Undulation
from roadstate.linalg import root, rss
from roadstate.statespace import StateSpaceModel

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

SPEED, SLOPE, SLOPE_RATE, BIAS, SCALE = range(5)
_LIGHTER = 0.3  # share of its weight by which no road makes a car lighter or heavier
_CAUGHT = 2.0  # m/s: 1σ of what a sensor's lies do to the speed until they are found
_LIGHTNESS = (0.3, 1.8)  # the file's mass over the car's, with any load and with none, if the file's had one


class AlongInput(NamedTuple):
    """What is known at one instant.

    Attributes:
        accel: specific force along x, freed of pitch, plus v_y r, m/s².
        by_torque: whether torques tell it, for want of an accelerometer that does.
        gaining: how fast the car speeds up, low-passed, m/s².
        lean: that at which the body would for good pitch as far as it does now, m/s².
        lasting: what of it lasts for half a second, m/s². Scale and pitch gradient multiply that: did they
            multiply all that a rough road shakes the accelerometer by, it would pass for their effect.
        drive, brake: specific forces of drive and brakes as torques tell them, low-passed, m/s².
        rolling: g with the sign of the speed: what the coefficient of rolling resistance multiplies, m/s².
        lever: what each N·m of the engine makes, in the gear in mesh, m/s²/(N·m).
        turned: specific force that turns up wheels and engine, no less as the car is loaded, m/s².
        speed: so far, m/s.
        passing: how fast the road comes by, m/s: faster than that where the speed is lost.
        intensity: of the acceleration's white error, m/s²/√Hz.
        smooth_across: low-passed specific force across, freed of roll, m/s².
        turning: yaw rate, rad/s.
        pitching: what turns the body's attitude.
        loading: of goods or passengers, which may just have been noticed.
        undulation: of the road, so far.
        tilting: how fast the slope changes as the car turns on a plane, m/s³, and 1σ of that.
        slip: (4,) what the force of each wheel makes it slip.
        sensor_std: (m,) 1σ of a sample.
    """

    accel: Float[Array, ""]
    by_torque: Bool[Array, ""]
    gaining: Float[Array, ""]
    lean: Float[Array, ""]
    lasting: Float[Array, ""]
    drive: Float[Array, ""]
    brake: Float[Array, ""]
    rolling: Float[Array, ""]
    lever: Float[Array, ""]
    turned: Float[Array, ""]
    speed: Float[Array, ""]
    passing: Float[Array, ""]
    intensity: Float[Array, ""]
    smooth_across: Float[Array, ""]
    turning: Float[Array, ""]
    pitching: Pitching
    loading: Loading
    undulation: Undulation
    tilting: Float[Array, " 2"]
    slip: Float[Array, " 4"]
    sensor_std: Float[Array, " m"]


class AlongModel(StateSpaceModel):
    """Speed, slope, and the errors of sensors and car, as far as the channels tell of them.

    x = [v_x, g sin θ, its rate of distance, b, κ | ψ_m | δk, b_q, δk_φ, φ_m | ε_σ | ε_m, γ_d, γ_b, ε_a, w,
    δf, δT | ε_R, δτ | Θ | z, z_wander], affine but for w, with v̇_x = a_x − b − κ ā_x − ψ_m ā_y − g sin θ +
    v_y r: bias, scale and mounting yaw of the accelerometer (the last with a lateral one); with a pitch rate
    the errors of the pitch gradient k, of the gyroscope, of the roll gradient and the mounting roll, and the
    body's nose-up attitude Θ̇ = Θ̇_told + b_q + r (δk_φ ā_y + φ_m); with wheels how much more all of them slip
    than their forces say; with torques the relative errors of mass, drive, brakes and drag area, the wind w
    from ahead, and δf, that of the rolling resistance and of what wheels' torques tell where there is none,
    which of an engine's is δT; that of the rolling radius, and by how much it is later than usual, with a
    speed that is not the wheels'; height with an altitude.

    Sensors: the wheels' speeds (freed of yaw and of the slip σ_i that their forces make: v_x + |v| σ_i ε_σ),
    the speed signal, late by a time τ of its own: v_x − τ v̇; altitude, rate of climb;
    ``traction``: how much more the accelerometer reads than the torques explain, b + κ ā_x + ψ_m ā_y +
    γ_d a_d − γ_b a_b − ε_m (a_d − a_b − a_air − a_ω) − Δa_air − δf g + δT ∂a_d/∂T, where a_ω turns up
    wheels and engine, air resists by a_air = d v|v| at rest and Δa_air = (1 + ε_a) d (v + w)|v + w| − d v|v|
    more in fact; ``attitude``: how much more the body pitches than by the slope and its lean, 0 = Θ − θ −
    k ℓ − δk ā_x, ℓ the lean in terms of a lasting force, ā_x what lasts.

    Attributes:
        road: how g sin θ changes along the road.
        slow_factor: of the covariance of the states from b to δτ: κ = g δk + the accelerometer's own.
        slow_time: s, how long they last.
        wander: 1σ (m) and duration (s) of the altitude's slow error.
        lean_gradient: pitch of the body over the specific force that it is due to, rad/(m/s²).
        air: how it holds the car back.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    road: GradePrior
    slow_factor: Float[Array, "k k"]
    slow_time: Float[Array, " k"]
    wander: Float[Array, " 2"]
    lean_gradient: Float[Array, ""]
    air: Air

    def __init__(
        self, vehicle: Vehicle, available: Collection[str], *, torque_of: Literal["wheels", "engine"] | None
    ) -> None:
        prior, sensors = vehicle.prior, vehicle.sensors
        wheels = tuple(f"wheel_speed_{w}" for w in WHEELS if f"wheel_speed_{w}" in available)
        slow = slow_errors(vehicle, available, torque_of)
        aids = [c for c in ("speed", "altitude", "vertical_speed") if c in available]
        height = ("altitude", "altitude_error") if "altitude" in available else ()
        attitude = ("attitude",) if "pitch_rate" in available else ()
        self.states = ("speed", "slope", "slope_rate", *slow, *attitude, *height)
        self.sensors = (*wheels, *aids, *(["traction"] if torque_of is not None else []), *attitude)
        self.road = GradePrior(leaf(GRAVITY * prior.grade_std), leaf(prior.grade_correlation_length))
        self.slow_factor = jnp.asarray(slow_factor({name: std for name, (std, _) in slow.items()}))
        self.lean_gradient = leaf(vehicle.body.pitch_gradient)
        self.air = Air(vehicle)
        self.slow_time = jnp.asarray(np.array([time for _, time in slow.values()]))
        self.wander = jnp.asarray([sensors.altitude.wander, sensors.altitude.wander_time])

    def place(self, state: str) -> int:
        """Row of a state."""
        return self.states.index(state)

    @property
    def _gains(self) -> NDArray[np.int_]:
        """(2,) rows of the torques' gains, of drive and brakes."""
        return self.place("drive_gain") + np.arange(2)

    def f(self, x: Float[Array, " n"], u: AlongInput, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """Explicit Euler in the speed, exact in the rest."""
        count = len(self.slow_time)
        road = (self.road.transition(u.passing * dt) @ x[1:3]).at[0].add(dt * u.tilting[0])
        slow = x[3 : 3 + count] * jnp.exp(-dt * self._fades(u))
        if "mass" in self.states:
            gains = self._gains - 3
            slow = slow.at[gains].set(jnp.where(u.loading.std > 0, u.loading.gains[0], slow[gains]))
        parts = [x[:1] + dt * self.speeds_up(x, u), road, slow]
        if "attitude" in self.states:
            roll = x[self.place("mounting_roll")] + x[self.place("roll_gradient")] * u.smooth_across
            rate = u.pitching.rate + x[self.place("pitch_rate_bias")] + u.turning * roll
            parts.append((x[3 + count] + dt * rate)[None])
        if "altitude" in self.states:
            climb = x[-2] + dt * u.speed * x[SLOPE] / GRAVITY
            parts.append(jnp.stack([climb, x[-1] * jnp.exp(-dt / self.wander[1])]))
        return jnp.concatenate(parts)

    def accel_error(self, x: Float[Array, " n"], u: AlongInput) -> Float[Array, ""]:
        """By how much the accelerometer reads too high, m/s²."""
        error = x[BIAS] + x[SCALE] * u.lasting
        if "mounting_yaw" in self.states:
            error += x[self.place("mounting_yaw")] * u.smooth_across
        return error

    def heave(self, gaussian: Gaussian, speed: Float[Array, ""]) -> Float[Array, " 2"]:
        """By what share tires bear more where the road bends up, and 1σ of it: v² dθ/ds over g.

        Args:
            gaussian: of the states.
            speed: m/s.
        """
        bends = jnp.stack([gaussian.mean[SLOPE_RATE], gaussian.std[SLOPE_RATE]])
        share = bends * (speed / GRAVITY) ** 2
        return share.at[0].set(jnp.clip(share[0], -_LIGHTER, _LIGHTER))

    def torque_error(self, x: Float[Array, " n"], u: AlongInput) -> Float[Array, ""]:
        """By how much less torques explain than there is, m/s²; nothing where none are told."""
        if "mass" not in self.states:
            return jnp.zeros(())
        mass, drive, brake = (x[self.place("mass") + i] for i in range(3))
        gains = drive * u.drive - brake * u.brake - mass * self.moved(u)
        gains -= self.headwind(x, u.speed)[0] + x[self.place("resistance")] * u.rolling
        if "torque_zero" in self.states:
            gains += x[self.place("torque_zero")] * u.lever
        return gains

    def moved(self, u: AlongInput) -> Float[Array, ""]:
        """By what of the specific forces that torques tell less is left as the car is loaded, m/s²."""
        return u.drive - u.brake - self.air.resists(u.speed) - u.turned

    def headwind(self, x: Float[Array, " n"], speed: Float[Array, ""]) -> tuple[Array, Float[Array, " n"]]:
        """By how much air resists more than it would at rest by the file, m/s², and its derivative.

        Args:
            x: states, among them those of torques.
            speed: m/s.
        """
        area, wind = self.place("drag_area"), self.place("wind")
        through, factor = speed + x[wind], 1 + x[area]
        resists = self.air.resists(through)
        row = jnp.zeros_like(x).at[area].set(resists)
        row = row.at[wind].set(2 * factor * self.air.drag * jnp.abs(through))
        return factor * resists - self.air.resists(speed), row

    def _fades(self, u: AlongInput) -> Float[Array, " k"]:
        """1/s by which slow states fade: a wind from ahead comes from aside as the car turns."""
        rate = 1 / self.slow_time
        if "wind" in self.states:
            rate = rate.at[self.place("wind") - 3].add(jnp.abs(u.turning) / WIND[1])
        return rate

    def _slow_noise(self, u: AlongInput, dt: Float[Array, ""]) -> Float[Array, "k k"]:
        """Factor of what slow states change by, and of a load that has just come."""
        slow = root(-jnp.expm1(-2 * dt * self._fades(u)))[:, None] * self.slow_factor
        if "mass" not in self.states:
            return slow
        at, gains, loads = self.place("mass") - 3, self._gains - 3, u.loading.std
        shared = u.loading.gains[2] / jnp.where(loads > 0, loads, jnp.inf)
        own = jnp.where(loads > 0, root(jnp.maximum(u.loading.gains[1] - shared**2, 0.0)), slow[gains, gains])
        slow = slow.at[gains, at].set(shared).at[gains, gains].set(own)
        return slow.at[at, at].set(rss(slow[at, at], loads))

    def _road_noise(self, u: AlongInput, dt: Float[Array, ""]) -> Float[Array, "2 2"]:
        """Factor of what slope and its rate change by, of a road that goes on and of a place that tilts."""
        (first, _), (cross, last) = u.undulation.scale * self.road.sqrt_Q(u.passing * dt)
        whole = rss(first, wander(u.tilting, dt))
        share = cross * first / jnp.where(whole > 0, whole, 1.0)
        own = root(last**2 + cross**2 - share**2)
        return jnp.stack([jnp.stack([whole, jnp.zeros_like(whole)]), jnp.stack([share, own])])

    def speeds_up(self, x: Float[Array, " n"], u: AlongInput) -> Float[Array, ""]:
        """dv_x/dt, m/s²: by the accelerometer, or by torques and what has been learnt of those."""
        return u.accel - x[SLOPE] + jnp.where(u.by_torque, self.torque_error(x, u), -self.accel_error(x, u))

    def h(self, x: Float[Array, " n"], u: AlongInput) -> Float[Array, " m"]:
        """In the order of the sensors."""
        rows = []
        for sensor in self.sensors:
            if sensor == "altitude":
                rows.append(x[-2] + x[-1])
            elif sensor == "vertical_speed":
                rows.append(u.speed * x[SLOPE] / GRAVITY)
            elif sensor == "traction":
                rows.append(self.accel_error(x, u) + self.torque_error(x, u))
            elif sensor == "attitude":
                leans = self.lean_gradient * u.lean + x[self.place("lean_gradient")] * u.lasting
                rows.append(x[self.place("attitude")] - x[SLOPE] / GRAVITY - leans)
            elif sensor == "speed":
                rows.append(x[SPEED] - (LATE[0] + x[self.place("speed_lag")]) * u.gaining)
            else:
                slips = u.slip[WHEEL_SPEEDS.index(sensor)] * x[self.place("slip_factor")]
                radius = x[self.place("wheel_radius")] if "wheel_radius" in self.states else 0.0
                rows.append(x[SPEED] + jnp.abs(u.speed) * slips - u.speed * radius)
        return jnp.stack(rows)

    def rolling(
        self, gaussian: Gaussian, speed: Float[Array, ""]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """By what share the rolling radius exceeds the file's, and 1σ of a slip that it and the speed feign.

        Args:
            gaussian: of the states.
            speed: m/s; slower than 1 m/s counts as that.
        """
        # κ = ((1 + ε) R ω − v)/|v|
        row = jnp.zeros_like(gaussian.mean).at[SPEED].set(-1 / jnp.maximum(jnp.abs(speed), 1.0))
        radius = jnp.zeros_like(speed)
        if "wheel_radius" in self.states:
            row = row.at[self.place("wheel_radius")].set(way(speed))
            radius = gaussian.mean[self.place("wheel_radius")]
        return radius, root(jnp.sum((row @ gaussian.factor) ** 2))

    def sqrt_Q(self, u: AlongInput, dt: Float[Array, ""]) -> Float[Array, "n n"]:
        """White acceleration, the road, and what slowly forgets."""
        blocks = [
            u.intensity[None, None] * root(dt),
            self._road_noise(u, dt),
            self._slow_noise(u, dt),
        ]
        if "attitude" in self.states:
            blocks.append(u.pitching.intensity[None, None] * root(dt))
        if "altitude" in self.states:
            # roads' unevenness and a slope that is not the car's path keep the height from being frozen
            uneven = 0.02**2 * jnp.abs(u.speed) * dt
            # and over a gap in the log, in which the speed is not known
            strays = 0.5 * dt * u.intensity * self.road.stationary_std[0] / GRAVITY
            height = root(uneven + strays**2 * dt)
            wander = self.wander[0] * root(-jnp.expm1(-2 * dt / self.wander[1]))
            blocks.append(jnp.diag(jnp.stack([height, wander])))
        return jnp.asarray(jsl.block_diag(*blocks))

    def loading(
        self, before: Loading, old: Gaussian, new: Gaussian, u: AlongInput, dt: Float[Array, ""]
    ) -> Loading:
        """Whether the mass is another since the car last stood; nothing where torques tell of none.

        Args:
            before: the same a sample ago.
            old: states after the sample before.
            new: states after this one.
            u: what is known of it.
            dt: s.
        """
        if "mass" not in self.states:
            return before
        at = self.place("mass")
        keeps = jnp.exp(-dt * self._fades(u)[at - 3])
        fresh = jnp.sum(self._slow_noise(u, dt)[at - 3] ** 2)
        predicted = keeps * old.mean[at], keeps**2 * jnp.sum(old.factor[at] ** 2) + fresh
        corrected = new.mean[at], jnp.sum(new.factor[at] ** 2)
        return before.take(predicted, corrected, self.gains(new), new.mean[SPEED], dt)

    def undulation(self, old: Gaussian, new: Gaussian, u: AlongInput, dt: Float[Array, ""]) -> Undulation:
        """How fast the road changes its slope, as a step's correction of that says.

        Args:
            old: states after the sample before.
            new: states after this one.
            u: what is known of it.
            dt: s.
        """
        passed = u.passing * dt
        row = self.road.transition(passed)[1]
        fresh = u.undulation.scale * self.road.sqrt_Q(passed)[1]
        foreseen = jnp.sum((row @ old.factor[SLOPE : SLOPE_RATE + 1]) ** 2) + jnp.sum(fresh**2)
        gone = jnp.maximum(foreseen - jnp.sum(new.factor[SLOPE_RATE] ** 2), 0.0)
        correction = new.mean[SLOPE_RATE] - row @ old.mean[SLOPE : SLOPE_RATE + 1]
        return u.undulation.take(correction, gone, jnp.abs(u.speed) * dt)

    def gains(self, gaussian: Gaussian) -> Float[Array, "3 2"]:
        """Of the torques of drive and brakes, as :attr:`Loading.gains` has them; 0 where there are none."""
        if "mass" not in self.states:
            return jnp.zeros((3, 2))
        at, factor = self._gains, gaussian.factor
        shared = factor[at] @ factor[self.place("mass")]
        return jnp.stack([gaussian.mean[at], jnp.sum(factor[at] ** 2, axis=1), shared])

    def lightness(self, mean: Float[Array, " n"]) -> Float[Array, ""]:
        """The file's mass over the car's: what torques make of the car is as much less."""
        if "mass" not in self.states:
            return jnp.ones(())
        return jnp.clip(1 - mean[self.place("mass")], *_LIGHTNESS)

    def sqrt_R(self, u: AlongInput) -> Float[Array, "m m"]:
        """Independent sensors."""
        return jnp.diag(u.sensor_std)

    def doubt(self, gaussian: Gaussian, caught: Bool[Array, ""], speed: Float[Array, ""]) -> Gaussian:
        """The prior but for speed and height, where a sensor has just been caught lying; else the same.

        What has been learnt of the slope, biases and the car may all come from that sensor.

        Args:
            gaussian: of the states.
            caught: whether one has been.
            speed: to begin with then, m/s.
        """
        prior = self.prior()
        count = 3 + len(self.slow_time)
        kept = (np.arange(len(self.states)) == SPEED) | (np.arange(len(self.states)) >= count)
        factor = prior.factor.at[SPEED, SPEED].set(_CAUGHT)
        old = gaussian.mean.at[SPEED].set(speed)
        mean = jnp.where(caught, jnp.where(kept, old, prior.mean), gaussian.mean)
        return Gaussian(mean, jnp.where(caught, factor, gaussian.factor))

    def prior(self) -> Gaussian:
        """Any speed a road car has, the road's own slope, any attitude, any height on land."""
        blocks = [jnp.asarray([[30.0]]), jnp.diag(self.road.stationary_std), self.slow_factor]
        if "attitude" in self.states:
            blocks.append(jnp.asarray([[0.3]]))
        if "altitude" in self.states:
            blocks.append(jnp.diag(jnp.stack([jnp.asarray(2000.0), self.wander[0]])))
        return Gaussian(jnp.zeros(len(self.states)), jnp.asarray(jsl.block_diag(*blocks)))
