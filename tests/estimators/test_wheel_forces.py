"""What each wheel has of its axle's forces, against sums, symmetry, a tire's curve and the plant's truth."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import WHEELS, Estimates, Log
from roadstate.core.quantities import reference
from roadstate.estimators import build
from roadstate.estimators.axle_forces import AxleForces
from roadstate.estimators.contact_forces import ForceMeter
from roadstate.estimators.wheel_forces import Known, WheelForces, WheelSharing
from roadstate.papers.base import MISMATCHED
from roadstate.papers.plants import told
from roadstate.run import batch
from roadstate.sim.manoeuvres import KMH, manoeuvre
from roadstate.sim.plant import multibody_plant
from roadstate.sim.run import drive, truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.tires import MagicFormula
from roadstate.vehicles import Vehicle

MIRRORED = [1, 0, 3, 2]
SATELLITE = {"speed", "altitude", "vertical_speed", "latitude", "longitude"}


def loaded(vehicle: Vehicle, load: list[float]) -> AxleForces:
    """What is known before the first sample, of wheels that bear so much."""
    forces = ForceMeter(vehicle, ["accel_x"]).nothing()
    return forces._replace(now=forces.now._replace(load=jnp.asarray(load)))


def shared(
    vehicle: Vehicle,
    along: list[float],
    across: tuple[float, float],
    load: list[float],
    *,
    axles: tuple[float, float] | None = None,
    friction: float = 0.9,
) -> WheelForces:
    forces = loaded(vehicle, load)._replace(along=jnp.asarray(along), along_std=jnp.zeros(4))
    by_torque = np.asarray(along).reshape(2, 2).sum(axis=1)
    known = Known(
        along=jnp.asarray(by_torque if axles is None else axles),
        along_std=jnp.asarray([60.0, 40.0]),
        across=jnp.asarray(across),
        across_std=jnp.asarray([90.0, 80.0]),
        friction=jnp.full(2, friction),
        mass=jnp.asarray(1.0),
        mass_std=jnp.asarray(0.0),
        speed=jnp.asarray(20.0),
    )
    return WheelSharing.of(vehicle).share(forces, known)


def test_wheels_make_up_their_axles(vehicle: Vehicle) -> None:
    found = shared(
        vehicle, [900.0, 700.0, -30.0, -50.0], (4000.0, -2500.0), [3000.0, 5000.0, 2500.0, 4500.0],
        axles=(1700.0, -100.0),
    )  # fmt: skip
    assert np.asarray(found.along).reshape(2, 2).sum(axis=1) == pytest.approx([1700.0, -100.0])
    assert np.asarray(found.across).reshape(2, 2).sum(axis=1) == pytest.approx([4000.0, -2500.0])
    assert found.along[0] > found.along[1]


def test_a_mirrored_car_has_mirrored_forces(vehicle: Vehicle) -> None:
    along, load = [900.0, 700.0, -30.0, -50.0], [3000.0, 5000.0, 2500.0, 4500.0]
    one = shared(vehicle, along, (4000.0, 2500.0), load)
    other = shared(vehicle, [along[i] for i in MIRRORED], (-4000.0, -2500.0), [load[i] for i in MIRRORED])
    signs = {"across": -1.0}
    for name in WheelForces._fields:
        expected = signs.get(name, 1.0) * np.asarray(getattr(one, name))[MIRRORED]
        assert np.asarray(getattr(other, name)) == pytest.approx(expected), name


@pytest.mark.parametrize("share", [0.15, 0.5, 0.98])
def test_wheels_at_the_same_slip_angle_push_as_a_magic_formula_tire_does(
    vehicle: Vehicle, share: float
) -> None:
    """Its own load sensitivity, of stiffness and of friction, is not told."""
    load, tire = np.array([2600.0, 5400.0]), MagicFormula.default()
    angles = np.linspace(0.001, 0.2, 200)[:, None]
    pushed = np.asarray(tire.forces(0.0, angles, load, 1.0, 20.0).F_y)
    axle = pushed.sum(axis=1)
    at = int(np.argmax(axle >= share * axle.max()))
    friction = float(axle.max() / load.sum())
    found = shared(vehicle, [0.0] * 4, (float(axle[at]), 0.0), [*load, 3000.0, 3000.0], friction=friction)
    # but for what the axle itself errs by
    own = np.sqrt(np.asarray(found.across_std)[:2] ** 2 - (90.0 * pushed[at] / axle[at]) ** 2)
    error = np.abs(np.asarray(found.across)[:2] - pushed[at])
    assert (error < 2 * own).all()
    assert error.max() < 0.03 * load.sum()


@pytest.mark.parametrize("name", ["along_std", "across_std", "load_std"])
def test_a_rough_road_and_standing_brakes_are_in_the_uncertainty(vehicle: Vehicle, name: str) -> None:
    sharing = WheelSharing.of(vehicle)
    calm = loaded(vehicle, [3500.0] * 4)._replace(along_std=jnp.zeros(4))
    two, one = jnp.zeros(2), jnp.ones(())
    known = Known(two, two, two, two, two + 0.9, one, 0.0 * one, 20.0 * one)
    usual = getattr(sharing.share(calm, known), name)
    rough = getattr(sharing.share(calm._replace(shaken=jnp.full(2, 0.3)), known), name)
    assert (rough > 1.2 * usual).all()
    parked = getattr(sharing.share(calm, known._replace(speed=0.0 * one)), name)
    assert (parked > 2 * usual).all() or name == "load_std"
    gently = getattr(sharing.share(calm._replace(locking=0.15 * one), known._replace(speed=0.0 * one)), name)
    locked = getattr(sharing.share(calm._replace(locking=0.7 * one), known._replace(speed=0.0 * one)), name)
    assert (gently < 1.05 * parked).all()
    assert (locked > 2 * parked).all() or name != "along_std"


def test_nothing_shakes_wheels_but_their_own_jolts(vehicle: Vehicle) -> None:
    sharing, two, one = WheelSharing.of(vehicle), jnp.zeros(2), jnp.ones(())
    calm = loaded(vehicle, [3500.0] * 4)._replace(along_std=jnp.zeros(4))
    known = Known(two, two, two, two, two + 0.9, one, 0.0 * one, 20.0 * one)
    usual = sharing.share(calm, known).along_std
    jolted = sharing.share(calm._replace(jolt=jnp.asarray([600.0, 0.0, 0.0, 0.0])), known).along_std
    assert jolted[0] > 500.0
    assert jolted[1:] == pytest.approx(usual[1:])


@pytest.fixture(scope="module")
def split_and_bend(vehicle: Vehicle) -> list[tuple[Log, Estimates]]:
    """Brakes on a road that is ice on the left, and a lane change, with vehicle files that are off."""
    logs = []
    for name, given in (
        ("split-road-braking", {}),
        ("double-lane-change", {"speed": 85 * KMH, "friction": 0.8}),
    ):
        script = manoeuvre(name).prepare(vehicle, **given)
        table = truth_table(drive(multibody_plant(vehicle, anti_lock=True), script, vehicle, rate=200.0))
        logs += [to_log(measure(table, sensor_preset("automotive"), seed=s, metadata={})) for s in range(2)]
    channels = [c for c in logs[0].available if c not in SATELLITE]
    cars = [build("joint", told(vehicle, MISMATCHED, s % 2), channels) for s in range(len(logs))]
    return list(zip(logs, batch(cars, logs), strict=True))


@pytest.mark.parametrize(("kind", "most"), [("force_x", 0.06), ("force_y", 0.06), ("load", 0.16)])
def test_wheels_of_a_car_on_the_plant(
    split_and_bend: list[tuple[Log, Estimates]], kind: str, most: float
) -> None:
    """Errors over the mean load; and intervals of 95 % that hold nine in ten samples, on either drive."""
    for log, said in split_and_bend:
        inside = []
        for w in WHEELS:
            true = reference(f"{kind}_{w}", log.channels)
            assert true is not None
            error = (said.values[f"{kind}_{w}"] - true)[100:]
            inside.append(np.abs(error) < 1.96 * said.std[f"{kind}_{w}"][100:])
            assert np.sqrt(np.mean(error**2)) < most * np.mean(log[f"ref_load_{w}"])
        assert np.mean(inside) > 0.85


def test_a_bend_that_nothing_tells_of_may_shift_the_load(vehicle: Vehicle) -> None:
    sharing, two, one = WheelSharing.of(vehicle), jnp.zeros(2), jnp.ones(())
    calm = loaded(vehicle, [3500.0] * 4)
    known = Known(two, two, two, two, two + 0.9, one, 0.0 * one, 20.0 * one)
    told = sharing.share(calm._replace(across_std=two), known).load_std
    assert (sharing.share(calm, known).load_std > 5 * told).all()


def test_what_is_not_told_across_is_not_shared(vehicle: Vehicle) -> None:
    """Without a lateral accelerometer nobody knows F_y, nor what a bend shifts."""
    channels = [f"wheel_speed_{w}" for w in WHEELS] + ["accel_x"]
    estimator = build("joint", vehicle, channels)
    given = eqx.filter_eval_shape(lambda: estimator.estimate(estimator.init())).values
    assert {f"force_x_{w}" for w in WHEELS} <= set(given)
    assert not {f"{kind}_{w}" for kind in ("force_y", "load") for w in WHEELS} & set(given)
