"""A road's grade and height along it."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from roadstate.core import InputError
from roadstate.core import numerics as numerics  # float64 before the first array


class GradeProfile(eqx.Module):
    """Grade and height as functions of the distance s travelled along the road.

    Between two knots sin θ follows half a cosine, so the grade has no kink anywhere (C¹) and the height
    z(s) = ∫ sin θ ds a closed form; two knots of equal grade bound a constant section, and beyond the first
    and last knot the grade stays as it is there. With u = (s − s_i)/(s_{i+1} − s_i) and a, b the sines at
    the knots: sin θ = a + (b − a)(1 − cos πu)/2.

    Args:
        distance: (K,) strictly increasing, in m; at least one.
        grade: (K,) grade angle at the knots in rad, uphill positive.
        start_altitude: height at the first knot in m.

    Raises:
        InputError: knots that do not increase, or a grade of 45° and more.
    """

    _distance: Float[Array, " K"]
    _sine: Float[Array, " K"]
    _altitude: Float[Array, " K"]

    def __init__(self, distance: ArrayLike, grade: ArrayLike, start_altitude: float = 0.0) -> None:
        s, theta = np.atleast_1d(np.asarray(distance, float)), np.atleast_1d(np.asarray(grade, float))
        if s.shape != theta.shape or s.ndim != 1 or len(s) == 0:
            raise InputError(f"a road of {s.shape} distances and {theta.shape} grades", mend="give as many")
        if not (np.isfinite(s).all() and (np.diff(s) > 0).all()):
            raise InputError("the road's distances do not increase", mend="sort them and drop repeated ones")
        if not (np.abs(theta) < np.pi / 4).all():
            raise InputError("a road's grade is 45° or more", mend="grades are angles in rad")
        sine = np.sin(theta)
        rise = np.diff(s) * (sine[1:] + sine[:-1]) / 2
        self._distance = jnp.asarray(s)
        self._sine = jnp.asarray(sine)
        self._altitude = jnp.asarray(start_altitude + np.concatenate([[0.0], np.cumsum(rise)]))

    def grade(self, s: ArrayLike | Float[Array, " *S"]) -> Float[Array, " *S"]:
        """Grade angle θ in rad at distance ``s`` (any shape, m)."""
        i, u, _ = self._locate(s)
        a, b = self._sine[i], self._sine[jnp.minimum(i + 1, len(self._sine) - 1)]
        return jnp.arcsin(a + (b - a) * (1 - jnp.cos(jnp.pi * u)) / 2)

    def altitude(self, s: ArrayLike | Float[Array, " *S"]) -> Float[Array, " *S"]:
        """Height in m at distance ``s`` (any shape, m)."""
        i, u, length = self._locate(s)
        a, b = self._sine[i], self._sine[jnp.minimum(i + 1, len(self._sine) - 1)]
        within = length * ((a + b) / 2 * u - (b - a) / (2 * jnp.pi) * jnp.sin(jnp.pi * u))
        outside = jnp.minimum(jnp.asarray(s) - self._distance[0], 0.0) * self._sine[0]
        outside += jnp.maximum(jnp.asarray(s) - self._distance[-1], 0.0) * self._sine[-1]
        return self._altitude[i] + within + outside

    def _locate(self, s: Any) -> tuple[Any, Float[Array, " *S"], Float[Array, " *S"]]:
        """Section index, place within it (0…1) and its length (m; 0 where the road is a single knot)."""
        last = len(self._distance) - 1
        i = jnp.clip(jnp.searchsorted(self._distance, jnp.asarray(s), side="right") - 1, 0, max(last - 1, 0))
        length = self._distance[jnp.minimum(i + 1, last)] - self._distance[i]
        u = (jnp.asarray(s) - self._distance[i]) / jnp.where(length > 0, length, 1.0)
        return i, jnp.clip(u, 0.0, 1.0), length


RAMP_SPEED = 9.7
"""Speed in m/s at which paper 002 drives its ramp, and by which its times become distances."""


def interchange_ramp(start_altitude: float = 250.0) -> GradeProfile:
    """The ramp of paper 002, §4.1 (Luo et al., J. Vibroengineering 2024), as a function of distance.

    The paper tells it in time at a constant 9.7 m/s: −1.8° to 27 s, 3.4° from 35.7 s to 57 s, −3.9° from 69 s
    to 88 s. It prints 3.5° for the end of the first transition and 3.4° for the section that follows: 3.4° is
    taken, as the section is the longer. What comes after 88 s it does not say; here a transition to level
    road until 98 s, level from there, is chosen. So is the height at the start.
    """
    seconds = np.array([0.0, 27.0, 35.7, 57.0, 69.0, 88.0, 98.0, 110.0])
    degrees = np.array([-1.8, -1.8, 3.4, 3.4, -3.9, -3.9, 0.0, 0.0])
    return GradeProfile(RAMP_SPEED * seconds, np.deg2rad(degrees), start_altitude)
