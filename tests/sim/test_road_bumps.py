"""Bumps on a road's surface."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import InputError
from roadstate.sim.roads.bumps import Bump, bumpy_surface

HOLE = Bump(12.0, 0.8, -0.05, right=-2.0, left=0.0)


def test_a_bump_is_a_wave_of_a_cosine_and_repeats() -> None:
    surface = bumpy_surface([HOLE, Bump(30.0, 0.4, 0.03)], 50.0)
    s = np.linspace(11.5, 13.5, 401)
    expected = np.where((s > 12) & (s < 12.8), -0.025 * (1 - np.cos(2 * np.pi * (s - 12) / 0.8)), 0.0)
    for lap in (0.0, 50.0):
        height, _, _ = surface.at(jnp.asarray(s + lap), jnp.full(401, -1.0))
        np.testing.assert_allclose(height, expected, atol=2e-4)
    across = jnp.linspace(-4.0, 4.0, 33)
    np.testing.assert_allclose(surface.at(jnp.full(33, 30.2), across)[0], 0.03, atol=1e-4)
    # the other side of the road is even
    np.testing.assert_allclose(surface.at(jnp.asarray(s), jnp.full(401, 1.0))[0], 0.0, atol=1e-12)


def test_its_slopes_are_those_of_its_height() -> None:
    surface, s = bumpy_surface([HOLE], 50.0), jnp.linspace(11.9, 12.9, 200)
    d, small = jnp.full(200, -0.1), 1e-5
    _, rise, tilt = surface.at(s, d)
    along = (surface.at(s + small, d)[0] - surface.at(s - small, d)[0]) / (2 * small)
    aside = (surface.at(s, d + small)[0] - surface.at(s, d - small)[0]) / (2 * small)
    np.testing.assert_allclose(rise, along, atol=1e-5)
    np.testing.assert_allclose(tilt, aside, atol=1e-5)


@pytest.mark.parametrize(
    "bump",
    [Bump(49.5, 1.0, 0.03), Bump(-1.0, 1.0, 0.03), Bump(5.0, 0.1, 0.03), Bump(5.0, 1.0, 0.03, 1.0, 0.0)],
)
def test_a_bump_that_is_not_on_the_surface_is_refused(bump: Bump) -> None:
    with pytest.raises(InputError, match="a bump of"):
        bumpy_surface([bump], 50.0)
