"""The bodies by MuJoCo, a rigid-body simulator that nobody here wrote, under the same tires and springs.

A 48 km/h lane change by a prescribed steering; straight vertical wheel paths in both, since a slide joint
does not turn the wheel carrier.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.sim.plant.conftest import Plane, drive, samples

from roadstate.sim.plant import Controls, PlantFigures, multibody_plant
from roadstate.sim.plant.contact import frames, ground, relax_slip
from roadstate.sim.plant.multibody import MultibodyPlant
from roadstate.sim.plant.rollout import start
from roadstate.sim.plant.vectors import cross, dot
from roadstate.vehicles import load_vehicle

_STRAIGHT = {
    "roll_centre_height": 0.0,
    "camber_per_travel": 0.0,
    "anti_pitch_drive": 0.0,
    "anti_pitch_brake": 0.0,
}
_FIGURES = {
    "front": _STRAIGHT,
    "rear": _STRAIGHT,
    "steering": {"caster": 0.0},
    "lift": {"front": 0.0, "rear": 0.0},
}
_STEP = 0.0005


def model_of(plant: MultibodyPlant, height: float) -> str:
    """The chassis as MuJoCo's XML: a free body and four that slide vertically in it."""
    masses, places = np.asarray(plant.chassis.masses), np.asarray(plant.chassis.places)
    inertia = " ".join(f"{v:.9g}" for v in np.diag(np.asarray(plant.chassis.inertia)))
    wheels = "".join(
        f'<body name="w{i}" pos="{places[0, i]:.9g} {places[1, i]:.9g} {places[2, i]:.9g}">'
        f'<joint type="slide" axis="0 0 1"/>'
        f'<inertial pos="0 0 0" mass="{masses[i]:.9g}" diaginertia="1e-4 1e-4 1e-4"/></body>'
        for i in range(1, 5)
    )
    centre = " ".join(f"{v:.9g}" for v in places[:, 0])
    return (
        f'<mujoco><option timestep="{_STEP}" gravity="0 0 -9.80665"/><worldbody>'
        f'<body name="car" pos="0 0 {height:.9g}"><freejoint/>'
        f'<inertial pos="{centre}" mass="{masses[0]:.9g}" diaginertia="{inertia}"/>{wheels}</body>'
        "</worldbody></mujoco>"
    )


def forces(
    plant: MultibodyPlant,
    road: Plane,
    R: Any,
    position: Any,
    hubs: Any,
    rate: Any,
    travel: Any,
    travel_rate: Any,
    spin: Any,
    slip: Any,
    steer: Any,
) -> Any:
    """Force and torque on each wheel's carrier in the world, springs, next spins and transient slips."""
    centres = R.T @ (hubs[:, :, 0] - position[:, None])
    moving = R.T @ hubs[:, :, 1]
    under = road.at(position[0], position[1])
    surface = ground(road, position, R, position[:2], centres, under)
    zero = jnp.zeros(4)
    axis = jnp.stack([-jnp.sin(steer), jnp.cos(steer), zero])
    frame = frames(axis, surface)
    turning = jnp.broadcast_to(rate[:, None], (3, 4))
    velocity = moving + cross(turning - dot(turning, axis) * axis, frame.arm)
    contact = plant.tires.contact(frame, velocity, spin, slip, surface.friction)
    about = dot(contact.moment, axis)
    gyroscopic = cross(turning, axis * (plant.chassis.spin_inertia * spin))
    torque = contact.moment - about * axis - gyroscopic
    spun = spin + _STEP * about / plant.chassis.spin_inertia
    slipped = relax_slip(slip, contact.slip_growth, contact.slip_decay, _STEP)
    springs = plant.suspension.elastic(travel) + plant.suspension.damping(travel_rate)
    return R @ contact.force, R @ torque, springs, spun, slipped, contact.load, contact.force_y


def by_mujoco(mujoco: Any, plant: MultibodyPlant, steer: np.ndarray, speed: float) -> tuple[Any, Any]:
    """(T, 4) loads and lateral forces, every 10 ms."""
    road, state = Plane(), start(plant, Plane(), speed)
    at_once = jax.jit(partial(forces, plant, road))
    model = mujoco.MjModel.from_xml_string(model_of(plant, float(state.motion.position[2])))
    data = mujoco.MjData(model)
    data.qvel[0] = speed
    mujoco.mj_forward(model, data)
    spin, slip = state.motion.spin, jnp.zeros((2, 4))
    rows, each = [], round(0.01 / _STEP)
    at = np.arange(len(steer) * each) / each
    steer = np.stack([np.interp(at, np.arange(len(steer)), column) for column in steer.T], axis=1)
    velocity = np.zeros(6)
    for k in range(len(steer)):
        R = data.xmat[1].reshape(3, 3).copy()
        hubs = np.zeros((3, 4, 2))
        hubs[:, :, 0] = data.xpos[2:6].T
        for i in range(4):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, 2 + i, velocity, 0)
            hubs[:, i, 1] = velocity[3:]
        # the rates of a free joint are along the body's axes
        free, sliding = data.qvel[3:6].copy(), (data.qpos[7:11].copy(), data.qvel[6:10].copy())
        found = at_once(R, data.xpos[1].copy(), hubs, free, *sliding, spin, slip, steer[k])
        force, torque, springs, spin, slip, load, lateral = found
        data.xfrc_applied[2:6, :3] = np.asarray(force).T
        data.xfrc_applied[2:6, 3:] = np.asarray(torque).T
        data.qfrc_applied[6:10] = np.asarray(springs)
        if k % each == 0:
            rows.append((np.asarray(load), np.asarray(lateral)))
        mujoco.mj_step(model, data)
    return tuple(np.stack(column) for column in zip(*rows, strict=True))


def test_a_lane_change_by_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo, the second opinion, is not installed")
    vehicle = load_vehicle("in-wheel-ev")
    plant = multibody_plant(vehicle, PlantFigures.model_validate(_FIGURES))
    plant = eqx.tree_at(lambda p: p.aerodynamics.area, plant, jnp.zeros(3))
    t, speed = samples(4.0), 48 / 3.6
    wheel = 1.0 * np.sin(2 * np.pi * 0.5 * t) * ((t > 0.5) & (t < 2.5))
    road = Plane()
    _, truth = drive(plant, road, start(plant, road, speed), Controls.make(steering_wheel=wheel, gear=0.0))
    load, lateral = by_mujoco(mujoco, plant, np.asarray(truth.steer), speed)

    peak = np.abs(truth.specific_force[:, 1]).max()
    assert peak > 2
    apart = np.sqrt(((load - truth.load) ** 2).mean(axis=0)) / truth.load.mean(axis=0)
    assert apart.max() < 0.03
    ours, theirs = (np.stack([f[:, :2].sum(axis=1), f[:, 2:].sum(axis=1)]) for f in (truth.force_y, lateral))
    apart = np.sqrt(((ours - theirs) ** 2).mean(axis=1)) / np.abs(ours).max(axis=1)
    assert apart.max() < 0.07
