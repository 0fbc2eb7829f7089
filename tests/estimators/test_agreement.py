"""What wheels tell before they have agreed on a speed: closed forms of four of them."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.estimators.agreement import (
    agreed,
    is_proven,
    is_sure,
    least_slip,
    most,
    proves,
    refutes,
    slips_least,
)

ALL = jnp.ones(4, bool)
DT = jnp.asarray(0.01)


def least(rims: list[float], bears: float, before: float = np.nan, unsure: float = 0.0) -> float:
    """Of four wheels that all tell something."""
    args = [jnp.asarray(x) for x in (bears, before, unsure)]
    return float(slips_least(jnp.asarray(rims), ALL, *args, DT))


class TestSlipsLeast:
    def test_wheels_that_push_turn_faster_and_those_that_brake_slower(self) -> None:
        rims = [12.0, 10.5, 11.0, 14.0]
        assert least(rims, 0.1) == 10.5
        assert least(rims, -0.1) == 14.0
        # one of three that neither push nor brake cannot pull the others along
        assert least([10.0, 10.2, 10.1, 40.0], 0.0) == pytest.approx(10.15)

    def test_what_was_before_holds_where_no_wheel_tells_and_else_nothing_does(self) -> None:
        silent = jnp.zeros(4, bool)
        for bears, before in ((0.1, 10.0), (-0.1, 10.0), (0.1, np.nan), (0.0, 10.0)):
            args = [jnp.asarray(x) for x in (bears, before, 0.0)]
            told = float(slips_least(jnp.full(4, 12.0), silent, *args, DT))
            creep = np.sign(bears) * 0.1 * 0.01
            assert told == pytest.approx(before + creep if bears else np.nan, nan_ok=True)

    def test_a_force_too_small_to_tell_its_sign_does_for_who_takes_it_so(self) -> None:
        args = [jnp.asarray(x) for x in (0.02, np.nan, 0.0)]
        rims = jnp.asarray([12.0, 10.5, 11.0, 14.0])
        assert float(slips_least(rims, ALL, *args, DT)) == pytest.approx(11.5)
        assert float(slips_least(rims, ALL, *args, DT, 0.015)) == 10.5

    def test_backward_as_well(self) -> None:
        """A force ahead makes a wheel of a car that backs up turn less fast: nearer to zero."""
        assert least([-4.0, -4.5, -4.2, -4.9], 0.1) == -4.9

    @pytest.mark.parametrize("bears", [0.1, -0.1])
    def test_an_envelope_of_wheels_that_come_up_to_the_speed_in_turn(self, bears: float) -> None:
        """The car keeps 20 m/s, each wheel leaves it and comes back within a second."""
        told, worst = np.nan, 0.0
        for i in range(400):
            slips = 0.15 * (1 + np.cos(2 * np.pi * i * 0.01 + np.array([0.0, 1.0, 2.0, 3.0])))
            told = least(list(20 * (1 + np.sign(bears) * slips)), bears, told)
            if i > 100:
                worst = max(worst, abs(told - 20))
        assert worst < 0.1

    def test_what_was_told_is_let_go_of_as_the_acceleration_is_unsure(self) -> None:
        """No wheel comes near it any more: after a second it is off by the creep and twice that 1σ."""
        told = 10.0
        for _ in range(100):
            told = least([15.0] * 4, 0.1, told, unsure=0.5)
        assert told == pytest.approx(10 + 0.1 + 2 * 0.5)


class TestMost:
    def test_all_but_one(self) -> None:
        members, speed = most(jnp.asarray([10.0, 10.1, 3.0, 9.9]), ALL, ALL)
        assert members.tolist() == [True, True, False, True]
        assert speed == pytest.approx(10.0)

    def test_two_and_two_are_no_majority(self) -> None:
        assert not most(jnp.asarray([10.0, 10.1, 5.0, 5.1]), ALL, ALL)[0].any()

    def test_wheels_of_one_axle_have_to_agree_both(self) -> None:
        front = jnp.asarray([True, True, False, False])
        assert most(jnp.asarray([10.0, 10.1, 0.0, 0.0]), front, ALL)[0].tolist() == front.tolist()
        assert not most(jnp.asarray([10.0, 12.0, 0.0, 0.0]), front, ALL)[0].any()

    def test_neither_wheels_that_race_nor_locked_ones_count(self) -> None:
        rims = jnp.asarray([10.0, 10.0, 10.0, 10.0])
        assert not most(rims, ALL, jnp.asarray([True, True, False, False]))[0].any()
        assert not most(jnp.zeros(4), ALL, ALL)[0].any()


class TestProof:
    def seconds(self, members: list[bool], bears: float = 0.0) -> float:
        """Until wheels are believed."""
        proof, steps = jnp.zeros(()), 0
        agree = jnp.asarray(members)
        while not is_proven(proof) and steps < 200:
            proof, steps = proves(proof, agree, is_sure(agree, ALL, jnp.asarray(bears)), DT), steps + 1
        return 0.01 * steps

    def test_three_have_to_agree_for_longer_than_all(self) -> None:
        assert self.seconds([True] * 4) < 0.1
        assert 0.3 < self.seconds([True, True, True, False]) < 0.8
        assert self.seconds([False] * 4) == 2.0

    @pytest.mark.parametrize("bears", [-0.1, 0.1])
    def test_so_have_all_while_a_force_may_make_them_slip_alike(self, bears: float) -> None:
        assert 0.3 < self.seconds([True] * 4, bears) < 0.8

    def test_once_proven_it_stays(self) -> None:
        nothing, sure = jnp.zeros(4, bool), jnp.asarray(False)
        assert is_proven(proves(jnp.asarray(0.06), nothing, sure, DT))
        assert proves(jnp.asarray(0.04), nothing, sure, DT) == 0.0

    def test_who_may_agree_by_chance_is_taken_after_some_time(self) -> None:
        sure, unsure, speed = jnp.asarray(True), jnp.asarray(False), jnp.asarray(10.0)
        three = jnp.asarray([True, True, True, False])
        assert agreed(jnp.asarray(8.0), three, speed, unsure, jnp.asarray(0.005)) == 8.0
        assert agreed(jnp.asarray(8.0), three, speed, unsure, jnp.asarray(0.02)) == 10.0
        assert agreed(jnp.asarray(8.0), ALL, speed, sure, jnp.zeros(())) == 10.0
        assert agreed(jnp.asarray(8.0), jnp.zeros(4, bool), speed, unsure, jnp.asarray(1.0)) == 8.0


@pytest.mark.parametrize(
    ("bears", "rolling", "expected"),
    [
        (-0.1, 12.0, True),  # braked, and faster than the car was thought to be
        (-0.1, 8.0, False),  # as brakes do
        (-0.1, 11.5, False),  # within what is not known
        (0.1, 8.0, True),
        (0.1, 12.0, False),
        (0.0, 12.0, False),
    ],
)
def test_a_wheel_refutes_a_speed_on_the_side_where_its_force_cannot_bring_it(
    bears: float, rolling: float, expected: bool
) -> None:
    speed, spread = jnp.asarray(10.0), jnp.asarray(0.3)
    assert bool(refutes(jnp.asarray(rolling), jnp.asarray(bears), speed, spread)) == expected


def test_wheels_that_are_apart_and_nobody_knows_why_tell_less() -> None:
    rims, apart = jnp.asarray([10.0, 10.0, 10.0, 15.0]), jnp.asarray(5.0)
    clear, puzzling = (np.asarray(least_slip(rims, apart, jnp.asarray(x))) for x in (True, False))
    assert clear[0] == pytest.approx(0.3)
    np.testing.assert_allclose(puzzling - clear, 1.0)
