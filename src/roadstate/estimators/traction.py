"""Force at the wheels from what the driveline and the brakes tell, and when not to believe it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import NDArray

from roadstate.core.channels import WHEELS
from roadstate.core.errors import InputError
from roadstate.estimators.base import Sample
from roadstate.estimators.signals import NEVER, STANDSTILL_SPEED, Held
from roadstate.linalg import root

if TYPE_CHECKING:
    from collections.abc import Collection

    from roadstate.vehicles import Vehicle

UNKNOWN = {"shift": 1.5, "brake": 6.0, "drive": 3.0}
"""m/s²/√Hz: intensity of a force that is not known."""
_SLOWEST_RATIO = 2.0  # m/s: below it a ratio of two speeds says nothing
_IDLE = 100.0  # rad/s: no engine that has gears turns more slowly, but its clutch or converter slips
_APART = (3.0, 0.1)  # rad/s, and as a share, by which engine and gears differ where nothing slips
_HEARD = 0.5  # s for which an engine's speed tells
_SHIFT_TIME = 0.7  # s after a change of gear, or a slip, in which torque and inertia are not what they seem
_RATIO_JUMP = 0.08  # relative change of a ratio from sample to sample that counts as another gear
# relative change of a measured ratio that means slip or a shift, and s it is taken over; 1/s, of a rare one
_RATIO_CHANGE, _RATIO_TIME, _RATIO_RATE = 0.05, 0.1, 0.35
_BRAKE_RELATIVE = 0.2  # 1σ of a brake's torque per pressure (pads, temperature)
LEAST_BRAKING = 0.15
"""m/s²: a brake torque that slows the car down by less is noise or drag."""
_LEAST_PRESSURE = 1e5  # Pa: as much holds the pads back
# m/s² by which drive changes within a second before its samples tell, and s that they are asked for
_WANDERS = (0.5, 10.0)
_GAP_TIME = 5.0  # s for which the longest time between two samples is remembered
_LONGEST_GAP = 2.0  # s
_LEAST_STEP = 1e-3  # s
_DRIVE = tuple(f"drive_torque_{w}" for w in WHEELS)


class Traction(NamedTuple):
    """What drives the car at one instant.

    Attributes:
        force: N along x, brakes included as far as they are known.
        drive_force: N, the drive's part.
        lever: N of that per N·m that the torque signal tells too little.
        torque_std: N, 1σ of the torque signal's noise.
        brake_std: N, 1σ of the brakes' part, which keeps as long as the brakes act.
        inertia: kg, mass of the car with its rotating parts.
        engine: kg·m², the engine's part of it as the wheels feel it.
        age: s since the torque was last seen.
        held_std: N, 1σ of what the drive's part may have changed by since the torque came, and
        held_noise: N/√Hz, intensity of that: torques that come rarely tell little of what is between.
        is_shifting: the driveline is open, slipping or changing gear.
        is_braking: a brake channel says that brakes act.
        is_brake_unknown: they act with a force that no channel tells.
        drive_torque: (4,) N·m, the drive's part at each wheel.
        brake_torque: (4,) N·m, the brakes' at each wheel as far as it is known, a magnitude.
    """

    force: Float[Array, ""]
    drive_force: Float[Array, ""]
    lever: Float[Array, ""]
    torque_std: Float[Array, ""]
    brake_std: Float[Array, ""]
    inertia: Float[Array, ""]
    engine: Float[Array, ""]
    age: Float[Array, ""]
    held_std: Float[Array, ""]
    held_noise: Float[Array, ""]
    is_shifting: Bool[Array, ""]
    is_braking: Bool[Array, ""]
    is_brake_unknown: Bool[Array, ""]
    drive_torque: Float[Array, " 4"]
    brake_torque: Float[Array, " 4"]

    @classmethod
    def unknown(cls, inertia: Float[Array, ""]) -> Traction:
        """Of a car of so much :attr:`inertia` that no channel of its drive tells of."""
        z, four, no = jnp.zeros(()), jnp.zeros(4), jnp.zeros((), bool)
        return cls(z, z, z, z, z, inertia, z, z + NEVER, z, z, no, no, no, four, four)


class TractionState(NamedTuple):
    """Held channels, the last ratio and the time since it last changed (s).

    Attributes:
        held, ratio, since_shift: these.
        usual: (2,) the ratio by the wheels' rims and by the car's speed, low-passed where it is measured.
        drive: N, the drive's part at the last sample.
        gap: s, the longest of late without a torque.
        changes: N²/s, mean square of the drive's changes.
    """

    held: dict[str, Held]
    ratio: Float[Array, ""]
    usual: Float[Array, " 2"]
    since_shift: Float[Array, ""]
    drive: Float[Array, ""]
    gap: Float[Array, ""]
    changes: Float[Array, ""]


class TractionMeter(eqx.Module):
    """Reads wheel torques, or engine torque × ratio × efficiency, and the brakes.

    Sources in order of preference: ``drive_torque_*`` of all driven wheels; ``engine_torque`` with
    ``gear_ratio``; of a vehicle of one single ratio by itself; with ``engine_speed``, whose quotient with
    the wheel speed is the ratio in mesh (so that power, not the gear, is what must be known; negative in
    reverse). Efficiency counts both ways: it lessens the drive and adds to the drag of an overrun engine.
    The engine's inertia follows the ratio. Where clutch or converter slip, as when a car sets off, neither
    is known: an ``engine_speed`` beside the gear tells so; without one they do, in a car of several gears,
    where these turn more slowly than an engine idles.

    Attributes:
        channels: canonical channels read.
        knows_brakes: whether any brake channel is there.
    """

    channels: tuple[str, ...] = eqx.field(static=True)
    knows_brakes: bool = eqx.field(static=True)
    source: str = eqx.field(static=True)
    _wheels: tuple[str, ...] = eqx.field(static=True)
    _measures_brakes: bool = eqx.field(static=True)
    _has_gears: bool = eqx.field(static=True)
    _torque_noise: Float[Array, ""]
    _radius: Float[Array, ""]
    _mass: Float[Array, ""]
    _engine_inertia: Float[Array, ""]
    _efficiency: Float[Array, ""]
    _final_drive: Float[Array, ""]
    _single_ratio: Float[Array, ""]
    _split: Float[Array, " 4"]
    _ratio_range: Float[Array, " 2"]
    _brake_gain: Float[Array, " 4"]
    _brake_shares: Float[Array, "4 4"] | None

    def __init__(self, vehicle: Vehicle, available: Collection[str]) -> None:
        driveline = vehicle.driveline
        ratios = [r * driveline.final_drive for r in driveline.gear_ratios] or [driveline.final_drive]
        driven = [w for w, drives in zip(_DRIVE, driveline.drives, strict=True) if drives]
        wheels = tuple(w for w in driven if w in available)  # a sensor elsewhere would add its error only
        unseen = [w for w in driven if w not in wheels]
        if not unseen:
            self.source, used = "wheels", wheels
            self._torque_noise = jnp.asarray(vehicle.sensors.wheel_torque.noise * len(wheels) ** 0.5)
        elif "engine_torque" in available:
            self._torque_noise = jnp.asarray(vehicle.sensors.engine_torque.noise)
            if "gear_ratio" in available:
                speed = tuple(c for c in ("engine_speed",) if c in available)
                self.source, used = "gear", ("engine_torque", "gear_ratio", *speed)
            elif len(ratios) == 1:
                self.source, used = "single", ("engine_torque",)
            elif "engine_speed" in available:
                self.source, used = "speeds", ("engine_torque", "engine_speed")
            else:
                raise InputError(
                    "engine torque alone does not give the force at the wheels of a car with several gears",
                    where=f"vehicle '{vehicle.name}'",
                    mend="map 'gear_ratio' or 'engine_speed'",
                )
        else:
            raise InputError(
                f"no drive torque: {unseen[0]} is missing and there is no engine_torque",
                where=f"vehicle '{vehicle.name}', driven: {driveline.driven}",
                mend="map 'engine_torque' or 'drive_torque_*' of all driven wheels",
            )
        brakes = [f"{kind}_{w}" for kind in ("brake_torque", "brake_pressure") for w in WHEELS]
        brakes = [b for b in (*brakes, "brake") if b in available]
        self.knows_brakes = bool(brakes)
        told = [
            f"brake_torque_{w}" in brakes or (f"brake_pressure_{w}" in brakes and vehicle.brakes is not None)
            for w in WHEELS
        ]
        self.channels = (*used, *brakes)
        self._wheels = wheels
        self._radius = jnp.asarray(vehicle.wheels.radius)
        self._mass = jnp.asarray(vehicle.effective_mass(0.0))
        self._engine_inertia = jnp.asarray(0.0 if self.source == "wheels" else driveline.engine_inertia)
        self._has_gears = len(ratios) > 1
        self._efficiency = jnp.asarray(driveline.efficiency)
        self._final_drive = jnp.asarray(driveline.final_drive)
        self._single_ratio = jnp.asarray(ratios[0])
        self._split = jnp.asarray(np.array([(w in driven) / len(driven) for w in _DRIVE]))
        self._ratio_range = jnp.asarray(np.array([0.85 * min(ratios), 1.15 * max(ratios)]))
        gains = (0.0, 0.0)
        if vehicle.brakes is not None:
            gains = (vehicle.brakes.torque_per_pressure_front, vehicle.brakes.torque_per_pressure_rear)
        each = np.array([gains[0], gains[0], gains[1], gains[1]])
        self._brake_gain = jnp.asarray(each)
        shares = None if all(told) else _brakes_of(np.array(told), each)
        self._measures_brakes = all(told) or shares is not None
        self._brake_shares = None if shares is None else jnp.asarray(shares)

    def init(self) -> TractionState:
        """Nothing has come yet."""
        zero, held = jnp.zeros(()), {c: Held.empty() for c in self.channels}
        return TractionState(held, zero, jnp.zeros(2), zero, zero, zero, (_WANDERS[0] * self._mass) ** 2)

    def read(
        self,
        state: TractionState,
        sample: Sample,
        speed: Float[Array, ""],
        dt: Float[Array, ""],
        rim: Float[Array, ""] | None = None,
    ) -> tuple[TractionState, Traction]:
        """Take a sample ``dt`` after the last.

        Args:
            state: from :meth:`init` or the last call.
            sample: the channels at this instant.
            speed: m/s, the estimate so far.
            dt: s.
            rim: R ω of the driven wheels, m/s, if it is known: wheels that spin turn the engine, too.
        """
        held = {c: state.held[c].take(sample[c], dt) for c in self.channels}
        ratio, usual, since_shift, is_shifting = self._gear(
            state, held, speed, speed if rim is None else rim, dt
        )
        if self.source == "wheels":
            zero = jnp.zeros(())
            each = jnp.stack([held[w].value if w in held else zero for w in _DRIVE])
            torque = jnp.sum(each)
            drive, lever = torque / self._radius, 1 / self._radius
        else:
            engine = held["engine_torque"]
            # power decides, and with it the engine's direction; at standstill it turns as it will drive
            turning = ratio * jnp.where(jnp.abs(speed) > STANDSTILL_SPEED, speed, ratio)
            is_driving = engine.value * turning > 0
            lever = ratio / self._radius * jnp.where(is_driving, self._efficiency, 1 / self._efficiency)
            drive = engine.value * lever
            each = drive * self._radius * self._split
        age = self._age(held)
        known = (self._age(state.held) < _LONGEST_GAP) & (age < _LONGEST_GAP)
        change = jnp.where(known, drive - state.drive, 0.0) ** 2 / jnp.maximum(dt, _LEAST_STEP)
        changes = state.changes - jnp.expm1(-dt / _WANDERS[1]) * (change - state.changes)
        gap = jnp.maximum(jnp.where(known, age, 0.0), state.gap * jnp.exp(-dt / _GAP_TIME))
        braking, pressed = self._brakes(held)
        brake = jnp.sum(braking) / self._radius
        engine_inertia = self._engine_inertia * ratio**2
        traction = Traction(
            force=drive - brake * jnp.sign(speed),
            drive_force=drive,
            lever=lever,
            torque_std=jnp.abs(self._torque_noise * lever),
            brake_std=_BRAKE_RELATIVE * brake,
            inertia=self._mass + engine_inertia / self._radius**2,
            engine=engine_inertia,
            age=age,
            held_std=root(changes * gap / 2),  # in the mean over the gap
            held_noise=root(changes / 3) * gap,  # a sawtooth of a random walk, from zero at each sample
            is_shifting=is_shifting,
            is_braking=pressed | (brake > 0),
            is_brake_unknown=pressed & (not self._measures_brakes),
            drive_torque=each,
            brake_torque=braking,
        )
        return TractionState(held, ratio, usual, since_shift, drive, gap, changes), traction

    def _age(self, held: dict[str, Held]) -> Float[Array, ""]:
        """s since the torque came, of wheels the one that is silent for longest."""
        names = self._wheels if self.source == "wheels" else ("engine_torque",)
        return jnp.max(jnp.stack([held[name].age for name in names]))

    def _gear(
        self, state: TractionState, held: dict[str, Held], speed: Array, rim: Array, dt: Float[Array, ""]
    ) -> tuple[Float[Array, ""], Float[Array, " 2"], Float[Array, ""], Bool[Array, ""]]:
        """Total ratio in mesh, what it usually is, s since it changed, and whether it is changing or open.

        The engine turns with the driven wheels' rims. But a change of gear shows by the car's speed as well:
        wheels that spin do not change the one ratio, those that hop over a bump not the other.
        """
        never = jnp.full((), 1e3)
        if self.source in ("wheels", "single"):
            return self._single_ratio * jnp.ones(()), state.usual, never, jnp.zeros((), bool)
        if self.source == "gear":
            ratio, usual = held["gear_ratio"].value * self._final_drive, state.usual
            changed = jnp.abs(ratio - state.ratio) > _RATIO_JUMP * jnp.abs(state.ratio)
            slips = self._slips(held, jnp.abs(ratio * rim) / self._radius)
            # as a clutch closes, an engine's inertia begins to weigh
            is_open, changed = (ratio == 0) | slips, changed | slips
        else:
            # measured where both speeds are new; else the gear last seen is still in mesh
            both = jnp.stack([rim, speed])
            moves = jnp.abs(both) > _SLOWEST_RATIO
            new = (held["engine_speed"].age == 0) & moves
            quotients = held["engine_speed"].value * self._radius / jnp.where(new, both, _SLOWEST_RATIO)
            gap = jnp.maximum(state.held["engine_speed"].age + dt, 1e-3)
            ratio = jnp.where(new[0], quotients[0], state.ratio)
            drift = jnp.abs(quotients - state.usual) / jnp.maximum(jnp.abs(state.usual), 1e-3)
            changed = jnp.all(new & (drift > jnp.maximum(_RATIO_RATE * gap, _RATIO_CHANGE)))
            leaps = jnp.abs(quotients[0] - state.ratio) > _RATIO_JUMP * jnp.abs(state.ratio)
            follows = jnp.where(leaps | (state.usual == 0), 1.0, -jnp.expm1(-gap / _RATIO_TIME))
            usual = state.usual + jnp.where(new, follows, 0.0) * (quotients - state.usual)
            low, high = self._ratio_range
            is_open = (jnp.abs(ratio) < low) | (jnp.abs(ratio) > high) | (~moves[0])
            ratio = jnp.where(ratio < 0, -1.0, 1.0) * jnp.clip(jnp.abs(ratio), low, high)
        since = jnp.where(changed, 0.0, state.since_shift + dt)
        return ratio, usual, since, is_open | (since < _SHIFT_TIME)

    def _slips(self, held: dict[str, Held], turning: Float[Array, ""]) -> Bool[Array, ""]:
        """Whether clutch or converter slip, so that the engine does not turn as the wheels make the gears.

        Args:
            held: the channels.
            turning: how fast the gears turn on the engine's side, rad/s.
        """
        slips = (turning < _IDLE) & self._has_gears
        if "engine_speed" not in held:
            return slips
        engine = held["engine_speed"]
        apart = jnp.abs(jnp.abs(engine.value) - turning) > _APART[0] + _APART[1] * turning
        return jnp.where(engine.age < _HEARD, apart, slips)

    def _brakes(self, held: dict[str, Held]) -> tuple[Float[Array, " 4"], Bool[Array, ""]]:
        """Known brake torques (N·m, ≥ 0) and whether pedal or pressure say that brakes act.

        Magnitudes of sensors' noise have a mean: what nobody brakes for counts only above a threshold.
        """
        torques = []
        pressed = jnp.zeros((), bool)
        for i, wheel in enumerate(WHEELS):
            torque = jnp.zeros(())
            if f"brake_torque_{wheel}" in held:
                torque = jnp.abs(held[f"brake_torque_{wheel}"].value)
            elif f"brake_pressure_{wheel}" in held:
                torque = self._brake_gain[i] * jnp.abs(held[f"brake_pressure_{wheel}"].value)
            if f"brake_pressure_{wheel}" in held:
                pressed |= held[f"brake_pressure_{wheel}"].value > _LEAST_PRESSURE
            torques.append(torque)
        if "brake" in held:
            pressed |= held["brake"].value > 0
        torque = jnp.stack(torques)
        if self._brake_shares is not None:
            torque = self._brake_shares @ torque
        acts = pressed | (jnp.sum(torque) > LEAST_BRAKING * self._mass * self._radius)
        return jnp.where(acts, torque, 0.0), pressed if self._measures_brakes else acts


def _brakes_of(told: NDArray[np.bool_], gain: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """(4, 4) torque of each brake by those that are told: as much as on the axle's other side, else as the
    same pressure makes of it; ``None`` where nothing says how much the other axle brakes."""
    if not told.any():
        return None
    share = np.diag(told.astype(float))
    for wheel in np.flatnonzero(~told):
        beside = wheel ^ 1
        if told[beside]:
            share[wheel, beside] = 1.0
            continue
        others = np.flatnonzero(told)
        if not gain[others[0]]:
            return None
        share[wheel, others] = gain[wheel] / gain[others[0]] / len(others)
    return share
