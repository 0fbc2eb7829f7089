"""The bank of friction hypotheses against closed forms."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.estimators.tires_on_road import straight_on

from roadstate.core.constants import GRAVITY
from roadstate.core.kernel import equations
from roadstate.core.numerics import in_single
from roadstate.estimators import slip_jump
from roadstate.estimators.friction_bank import VIEWS, BankState, FrictionBank
from roadstate.estimators.friction_curve import bounded
from roadstate.estimators.sideways import (
    BIAS_R,
    GIVE_F,
    SIZE,
    STIFF_F,
    STIFF_R,
    V_Y,
    Sideways,
    Touch,
    twisting,
)
from roadstate.vehicles import Vehicle


@eqx.filter_jit
def stepped(bank: FrictionBank, state: BankState, here: Touch) -> BankState:
    """After 10 ms."""
    return bank.step(state, here, jnp.asarray(0.01))[0]


class TestBank:
    def test_a_share_that_nothing_tells_is_no_news_at_every_sample(self, vehicle: Vehicle) -> None:
        """Of wheels that slide on .2 two seem to bear .05 more, two .05 less, 1σ of that being .06."""
        bank = FrictionBank(vehicle, ())
        least = []
        for lasts in (0.0, 0.06):
            bears = straight_on([0.25, 0.25, 0.15, 0.15], 0.3)._replace(
                along_std=jnp.full(4, 0.06), split_std=jnp.full(4, lasts)
            )
            state = self.driven(bank, (0.5, bears))
            least.append(float(bank.quantiles(state, (0.05,))[0, 0]))
        assert least[1] < 0.19 < least[0]

    def test_a_gyroscope_that_errs_moves_no_car_that_stands(self, vehicle: Vehicle) -> None:
        """At a walking pace the rear axle follows where it points, and a known bias turns it nowhere."""
        motion = Sideways(vehicle, ())
        here = straight_on()._replace(speed=jnp.zeros(()), yaw_rate=jnp.asarray(0.02))
        x = jnp.zeros((SIZE, 2)).at[BIAS_R, 1].set(0.02)
        P = jnp.broadcast_to(motion.first[:, :, None], (SIZE, SIZE, 2))
        moved, _ = motion.moved(x, P, here, jnp.asarray(0.01))
        to_rear = vehicle.geometry.cg_to_rear_axle
        np.testing.assert_allclose(moved[V_Y], [0.02 * to_rear, 0.0], atol=1e-6)

    def driven(self, bank: FrictionBank, *touches: tuple[float, Touch]) -> BankState:
        """The state after so many seconds of each."""
        state = bank.init()
        for seconds, here in touches:
            for _ in range(round(100 * seconds)):
                state = stepped(bank, state, here)
        return state

    @pytest.mark.parametrize("direction", [1.0, -1.0])
    def test_who_looks_first_in_the_midst_of_a_bend_knows_no_limit(
        self, vehicle: Vehicle, direction: float
    ) -> None:
        """A force that was there from the first sample on has not grown up to where it stays."""
        bank, force, speed, turn = FrictionBank(vehicle, ()), 0.3, 8.0, 0.3 * GRAVITY / 8.0
        slides = force / np.asarray(bank.motion.stiffness)
        sideways = -bank.motion.arm[1] * turn - direction * speed * slides[1]
        gives = np.asarray(bank.motion.give) * force
        bend = straight_on()._replace(
            speed=jnp.asarray(direction * speed),
            yaw_rate=jnp.asarray(direction * turn),
            accel_y=jnp.asarray(force * GRAVITY),
            across=jnp.full(2, force),
            angle=jnp.asarray(slides + gives + direction * float(sideways) / speed),
        )
        state = self.driven(bank, (3.0, bend))
        low, high = np.asarray(bank.quantiles(state, (0.05, 0.95)))[:, 0]
        assert low > 0.95 * force
        assert high > 0.9

    @pytest.mark.parametrize("often", [6.0, 7.0])
    def test_a_car_that_sways_does_not_slide(self, vehicle: Vehicle, often: float) -> None:
        """At a crawl, as on a rough road: v_y follows what the tires bear, though no bank explains it."""
        bank, time = FrictionBank(vehicle, ()), np.arange(0, 4, 0.01)
        sways, bears = 0.03 * np.sin(often * time), 0.03 * np.sin(5 * time)
        crawl = straight_on()._replace(speed=jnp.asarray(4.7))
        state, found, upper = bank.init(), [], []
        for a, f in zip(sways, bears, strict=True):
            here = crawl._replace(angle=jnp.full(2, a), across=jnp.full(2, f), accel_y=jnp.asarray(f))
            state = stepped(bank, state, here)
            found.append(float(bank.merged(state)[0][V_Y]))
            upper.append(float(bank.quantiles(state, (0.95,))[0, 0]))
        assert min(upper) > 0.8
        slides = 4.7 * (sways - bears / np.mean(np.asarray(bank.motion.stiffness)))
        assert np.sqrt(np.mean((np.asarray(found) - slides)[200:] ** 2)) < 0.06

    def test_what_nothing_tells_is_no_change(self, vehicle: Vehicle) -> None:
        """F_y begins where it is first known; a wheel that falls silent comes back as it was."""
        bank = FrictionBank(vehicle, ())
        slip = 0.2 / float(bank.wheels.slip_stiffness)
        here = straight_on(0.2, slip / (1 - slip))._replace(across=jnp.full(2, 0.3))
        blind = here._replace(across_std=jnp.full(2, jnp.inf), along_std=jnp.full(4, jnp.inf))
        blind = blind._replace(across=jnp.zeros(2), along=jnp.zeros(4), slip=jnp.zeros(4))
        nothing = self.driven(bank, (0.1, blind))
        np.testing.assert_array_equal(nothing.level, bank.init().level)
        assert float(bank.cornering(nothing)) == 0.0
        first = self.driven(bank, (0.1, blind), (0.01, here))
        assert float(bank.cornering(first)) == pytest.approx(0.3, rel=1e-6)
        np.testing.assert_array_equal(self.driven(bank, (0.01, here), (0.1, blind)).level, first.level)
        back = slip_jump.unexplained(here, bank.wheels.slip_stiffness)
        np.testing.assert_allclose(slip_jump.jumps(back, first.level[10:], here), 0.0, atol=1e-6)

    def after(self, bank: FrictionBank, seconds: float, along: float, slip: float) -> np.ndarray:
        state = self.driven(bank, (seconds, straight_on(along, slip)))
        return np.asarray(bank.quantiles(state, (0.05, 0.5, 0.95)))[:, 0]

    @pytest.mark.parametrize("gyro_error", [-0.03, 0.0, 0.03])
    def test_what_takes_a_gyroscopes_place_is_not_summed_up(
        self, vehicle: Vehicle, gyro_error: float
    ) -> None:
        """For 10 s of a bend nothing tells the motion across but what others make of the yaw rate."""
        motion, turn = Sideways(vehicle, ()), 0.1
        bend = straight_on()._replace(accel_y=jnp.asarray(15 * turn), yaw_rate=jnp.asarray(turn + gyro_error))
        lost = bend._replace(across_std=jnp.full(2, jnp.inf))
        x, P = jnp.zeros((SIZE, 1)), motion.first[:, :, None]
        move = jax.jit(lambda x, P: motion.moved(x, P, lost, jnp.asarray(0.01)))
        for _ in range(1000):
            x, P = move(x, P)
        follows, std = vehicle.geometry.cg_to_rear_axle * turn, float(P[V_Y, V_Y, 0]) ** 0.5
        assert abs(float(x[V_Y, 0]) - follows) < std
        assert 0.03 * 15 <= std < 0.05 * 15
        assert np.linalg.eigvalsh(P[:, :, 0]).min() > 0

    def test_what_steers_gives_less_the_nearer_it_is_measured(self, vehicle: Vehicle) -> None:
        """The file's front stiffness is the axle's, steering and all; the tires are stiffer."""
        column, wheel = Sideways(vehicle, ("steering_wheel",)), Sideways(vehicle, ("steer",))
        assert 0 < float(wheel.give[0]) < float(column.give[0]) / 2
        axle = 1 / vehicle.tires.cornering_stiffness_front
        for motion in (column, wheel):
            assert float(motion.give[0] + 1 / motion.stiffness[0]) == pytest.approx(axle)
        assert float(wheel.give[1]) == float(column.give[1])

    def test_a_car_slides_less_far_where_the_road_is_slippery(self, vehicle: Vehicle) -> None:
        """At their limit tires tell nothing of the sideslip; what is left is how far a driven car slides."""
        bank = FrictionBank(vehicle, ())
        std = {}
        for used in (0.3, 0.9):
            bears = straight_on()._replace(across=jnp.full(2, used))
            state = self.driven(bank, (10.0, bears))
            limit = int(np.argmin(np.abs(np.asarray(bank.friction) - used)))
            std[used] = float(state.P[V_Y, V_Y, limit]) ** 0.5 / 15
        assert std[0.3] < 0.03
        assert 0.02 < std[0.9] < 0.1

    def test_sliding_wheels_tell_the_friction_at_once(self, vehicle: Vehicle) -> None:
        # far beyond the peak: 0.28 is what a friction of 0.33 leaves there, and no slip error matters
        low, middle, high = self.after(FrictionBank(vehicle, ()), 0.3, along=0.28, slip=0.25)
        assert low < 0.33 < high
        assert middle < 0.5

    @pytest.mark.parametrize("inner", [0.15, 0.4])
    def test_an_inner_wheel_that_locks_leaves_the_outer_its_force(
        self, vehicle: Vehicle, inner: float
    ) -> None:
        """An axle bears across what its wheels do, each as much as it is loaded."""
        bank = FrictionBank(vehicle, ())
        bears = jnp.tile(jnp.asarray([inner, 1 - inner]), 2)
        soft = 1 - 0.4 * (1 - 2 * inner) ** 2
        truth, sideways = 0.85, 1.5
        here = straight_on()._replace(load=2 * bears, slip_std=jnp.full(4, 0.01))
        turns = []
        for slip in (jnp.zeros(4), jnp.asarray([-0.3, -0.02, -0.3, -0.02])):
            stiff = bank.wheels.slip_stiffness * slip / (1 + slip)
            forces = bounded(stiff, jnp.full(4, sideways), jnp.full(4, truth), bank.wheels.shape)
            across = (bears * forces.across).reshape(2, 2).sum(1)
            angle = sideways / (soft * bank.motion.stiffness) + bank.motion.give * across
            turns.append(here._replace(along=forces.along, across=across, slip=slip, angle=angle))
        state = self.driven(bank, (2.0, turns[0]), (0.5, turns[1]), (0.5, turns[0]), (0.5, turns[1]))
        low, high = np.asarray(bank.quantiles(state, (0.05, 0.95)))[:, 0]
        assert low < truth < high
        assert float(bank.likeliest(state)[0]) == pytest.approx(truth, rel=0.1)

    @pytest.mark.parametrize("load", [[0.35, 1.65, 0.35, 1.65], [1.4, 1.4, 0.6, 0.6]], ids=["bend", "brake"])
    def test_a_tire_that_bears_more_has_less_friction(self, vehicle: Vehicle, load: list[float]) -> None:
        """An axle that slides with most of its load on the outer wheel bears less than one with as much on
        each, and one that brakes less than its share: the road is the same."""
        bank, ahead = FrictionBank(vehicle, ()), load[0] == load[1]
        found = []
        for loads in (np.array(load), np.ones(4)):
            force = 0.8 * (1 - 0.1 * (loads - 1))
            across = (loads * force).reshape(2, 2).sum(1) / loads.reshape(2, 2).sum(1)
            along, turned = (
                {"along": -force, "slip": np.full(4, -0.4)},
                {"across": across, "angle": np.full(2, 0.4)},
            )
            here = {name: jnp.asarray(x) for name, x in (along if ahead else turned).items()}
            state = self.driven(
                bank, (0.3, straight_on()), (1.0, straight_on()._replace(load=jnp.asarray(loads), **here))
            )
            found.append(np.asarray(bank.likeliest(state))[1:3])
        np.testing.assert_allclose(found[0], found[1], rtol=0.025)

    def test_gentle_driving_tells_a_lower_bound_only(self, vehicle: Vehicle) -> None:
        low, _, high = self.after(FrictionBank(vehicle, ()), 3.0, along=0.1, slip=0.1 / 22)
        assert low < 0.4
        assert high > 1.0

    def test_wheels_that_slide_on_one_side_tell_of_that_side(self, vehicle: Vehicle) -> None:
        """Locked left wheels at 0.13, right ones that brake with 0.27 and hardly slip."""
        bank = FrictionBank(vehicle, ())
        rolling = straight_on()
        braking = straight_on([-0.13, -0.27, -0.13, -0.27], [-0.9, -0.27 / 22, -0.9, -0.27 / 22])
        state = self.driven(bank, (1.0, rolling), (1.0, braking))
        low, _, high = np.asarray(bank.quantiles(state, (0.05, 0.5, 0.95)))
        at = {view: i for i, view in enumerate(VIEWS)}
        assert low[at["_left"]] < 0.2 < high[at["_left"]] < 0.35
        assert high[at["_right"]] > 0.8
        # an axle, and the car, is the mean of its sides
        for quantiles in (low, high):
            mean = 0.5 * (quantiles[at["_left"]] + quantiles[at["_right"]])
            assert quantiles[at[""]] == pytest.approx(mean)
            assert quantiles[at["_front"]] == pytest.approx(mean, rel=0.35)

    def test_what_may_be_ice_or_asphalt_is_told_as_the_likelier_of_both(self, vehicle: Vehicle) -> None:
        """Before anything is known: the file's friction, with a deviation about that, though the median of
        all roads lies between."""
        bank = FrictionBank(vehicle, ())
        state = bank.init()
        told = bank.likeliest(state)
        median = np.asarray(bank.quantiles(state, (0.5,)))[0]
        np.testing.assert_allclose(told, vehicle.tires.friction, rtol=0.02)
        assert (median < 0.9 * np.asarray(told)).all()
        p = np.asarray(bank.prior, float)
        about = np.sqrt(np.sum(p * (np.asarray(bank.friction, float) - told[0]) ** 2))
        assert np.asarray(bank.std(state, told)) == pytest.approx(about, rel=0.03)

    def test_the_likeliest_of_a_part_that_is_two_is_their_mean(self, vehicle: Vehicle) -> None:
        bank = FrictionBank(vehicle, ())
        braking = straight_on([-0.13, -0.27, -0.13, -0.27], [-0.9, -0.27 / 22, -0.9, -0.27 / 22])
        told = np.asarray(bank.likeliest(self.driven(bank, (1.0, straight_on()), (1.0, braking))))
        at = {view: i for i, view in enumerate(VIEWS)}
        assert told[at["_left"]] < 0.25
        assert told[at["_right"]] > 0.6
        assert told[at[""]] == pytest.approx(0.5 * (told[at["_left"]] + told[at["_right"]]))

    def test_a_wheel_that_is_worn_is_known_by_its_rolling(self, vehicle: Vehicle) -> None:
        """Rolling freely it seems to slip 4 ‰: that is its radius, not friction."""
        bank = FrictionBank(vehicle, ())
        state = self.driven(bank, (30.0, straight_on(0.0, [0.004, 0.0, 0.0, 0.0])))
        offsets = np.asarray(state.y)[[0, 2], 2] @ np.asarray(state.weight).sum(axis=(0, 1))[5]
        assert 0.0025 < offsets[0] < 0.0042
        assert offsets[1] == pytest.approx(0.0, abs=0.0015)

    def test_a_wheel_on_ice_teaches_the_one_behind_it_nothing_of_its_tire(self, vehicle: Vehicle) -> None:
        """For .2 s the front wheels slide on ice and the rear ones brake on asphalt, then all are on ice."""
        bank = FrictionBank(vehicle, ())
        dry = straight_on(-0.7, -0.05)
        joint = straight_on([-0.13, -0.13, -0.7, -0.7], [-0.7, -0.7, -0.05, -0.05])
        both = self.driven(bank, (1.0, dry), (0.2, joint))
        near = int(np.argmin(np.abs(np.asarray(bank.friction) - 0.8)))
        shapes = np.asarray(both.y)[:, 1, near]
        assert np.abs(shapes[2:]).max() < 0.1 < np.abs(shapes[:2]).min()
        after = self.driven(bank, (1.0, dry), (0.2, joint), (0.5, straight_on(-0.13, -0.5)))
        low, middle, high = np.asarray(bank.quantiles(after, (0.05, 0.5, 0.95)))[:, 0]
        # sliding so far a tire of the file's shape bears .78 of its friction
        assert middle == pytest.approx(0.13 / 0.78, rel=0.1)
        assert 0.13 < low < high < 0.25

    def test_a_load_told_wrong_is_no_friction(self, vehicle: Vehicle) -> None:
        """Forces that are said to be 5 % more than they are, for however long, leave .8 within the bounds."""
        bank = FrictionBank(vehicle, ())
        slips = np.array([0.02, 0.05, 0.08, 0.11])
        braked = [0.8 * 1.05 * np.sin(1.45 * np.arctan(20 * s / 0.8 / 1.45)) for s in slips]
        phases = [(1.0, straight_on(-f, -s)) for f, s in zip(braked, slips, strict=True)] * 3
        low, _, high = np.asarray(bank.quantiles(self.driven(bank, *phases), (0.05, 0.5, 0.95)))[:, 0]
        assert low < 0.8 < high < 1.0

    @pytest.mark.parametrize(("shared", "slip", "seconds"), [(0.2, 0.05, 1.0), (0.015, 0.02, 0.2)])
    def test_no_tire_bears_more_than_the_friction(
        self, vehicle: Vehicle, shared: float, slip: float, seconds: float
    ) -> None:
        """After ice comes asphalt, of which forces tell: the speed is known too badly for any slip, or so
        badly that a slip's error might last for seconds."""
        bank = FrictionBank(vehicle, ())
        icy, dry = straight_on(-0.14, -0.25), straight_on(-0.6, -slip)
        unsure = dry._replace(slip_shared=jnp.asarray(shared))
        before, after = (
            np.asarray(bank.quantiles(self.driven(bank, (1.0, icy), (lasts, unsure)), (0.05, 0.5, 0.95)))
            for lasts in (0.0, seconds)
        )
        assert (before[2] < 0.4).all()
        assert (after[0] > 0.5).all()

    def test_nothing_of_a_step_is_in_double_precision(self, vehicle: Vehicle) -> None:
        """One number in double precision that meets the hypotheses doubles the work from there on."""
        bank = FrictionBank(vehicle, ())
        step = jax.make_jaxpr(lambda s, t, dt: bank.step(s, in_single(t), in_single(dt))[0])
        traced = step(bank.init(), straight_on(), jnp.asarray(0.01))
        many = [v.aval for e in equations(traced.jaxpr) for v in e.outvars if v.aval.size > 1]
        assert len(many) > 100
        floats = {aval.dtype for aval in many if jnp.issubdtype(aval.dtype, jnp.floating)}
        assert floats == {jnp.dtype("float32")}

    def test_weights_stay_a_distribution(self, vehicle: Vehicle) -> None:
        bank = FrictionBank(vehicle, ())
        state = self.driven(bank, (0.01, straight_on(0.5, 0.03)))
        total = np.asarray(state.weight).sum(axis=(0, 1, 3))
        np.testing.assert_allclose(total, 1, rtol=1e-6)


def test_noise_does_not_wear_the_stiffness_away(vehicle: Vehicle) -> None:
    # a steady bend on a level road, with white noise on acceleration and yaw rate
    bank, rng = FrictionBank(vehicle, ()), np.random.default_rng(1)
    speed, used = 15.0, 0.15
    angles = [used / vehicle.tires.cornering_stiffness_front, used / vehicle.tires.cornering_stiffness_rear]
    held = GRAVITY * used

    def body(state: BankState, noise: jax.Array) -> tuple[BankState, None]:
        here = straight_on()._replace(
            speed=jnp.asarray(speed),
            accel_y=held + noise[0],
            yaw_rate=held / speed + noise[1],
            lateral=0.3 * noise[0] - 0.3 * speed * noise[1],
            angle=jnp.asarray(angles),
            across=used + 0.3 * noise[:1] / GRAVITY * jnp.ones(2),
            lag=jnp.asarray(0.1),
        )
        return bank.step(state, here, jnp.asarray(0.01))[0], None

    noise = rng.normal(size=(3000, 2)) * np.array([0.08, 0.002])
    state, _ = jax.lax.scan(body, bank.init(), jnp.asarray(noise))
    mean, _ = bank.merged(state)
    assert np.abs(np.asarray(mean)[[STIFF_F, STIFF_R]]).max() < 0.05


def test_steering_gives_less_as_the_pneumatic_trail_shrinks() -> None:
    """By half where all of the friction is used, to either side; by nothing where none is."""
    across, friction = jnp.asarray([[0.0], [0.2], [-0.4], [0.9]]), jnp.asarray([0.4, 0.8])
    left = np.stack([twisting(straight_on()._replace(across=a), friction) for a in across])
    np.testing.assert_allclose(left, [[1, 1], [0.75, 0.875], [0.5, 0.75], [0.5, 0.5]], rtol=1e-6)


@pytest.mark.parametrize("friction", [0.6, 0.9])
def test_a_steering_that_gives_is_no_grip(vehicle: Vehicle, friction: float) -> None:
    """A bend ever sharper, on a car whose steering gives half as much as its file would have it."""
    bank = FrictionBank(vehicle, ())
    motion, dt, speed = bank.motion, 0.02, 15.0
    used = np.linspace(0.05, 0.93 * friction, 1500)
    half = 0.5 * np.asarray(twisting(straight_on()._replace(across=used[None]), friction))
    gives = np.asarray(motion.give) * np.stack([half, np.ones_like(half)], axis=1)
    slips = (
        friction * 1.45 * np.tan(np.arcsin(used / friction) / 1.45)[:, None] / np.asarray(motion.stiffness)
    )
    yaw_rate = GRAVITY * used / speed
    turned = slips + gives * used[:, None]
    sideways = -float(motion.arm[1]) * yaw_rate - speed * turned[:, 1]
    angle = turned + sideways[:, None] / speed
    gained = np.gradient(sideways, dt)

    def body(state: BankState, row: tuple[jax.Array, ...]) -> tuple[BankState, None]:
        angles, grip, rate, gain = row
        here = straight_on()._replace(
            speed=jnp.asarray(speed),
            accel_y=gain + speed * rate,
            yaw_rate=rate,
            lateral=gain,
            angle=angles,
            across=grip * jnp.ones(2),
            lag=jnp.asarray(0.0),
        )
        return bank.step(state, here, jnp.asarray(dt))[0], None

    rows = tuple(jnp.asarray(a) for a in (angle, used, yaw_rate, gained))
    state, _ = jax.lax.scan(body, bank.init(), rows)
    low, _, high = np.asarray(bank.quantiles(state, (0.05, 0.5, 0.95)))[:, 0]
    assert low < 1.05 * friction < high
    mean, std = bank.merged(state)
    assert abs(float(mean[GIVE_F]) + 0.5 * float(motion.give[0])) < 2 * float(std[GIVE_F])
