"""A road's grade and height along it."""

from __future__ import annotations

from typing import Any, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike, NDArray

from roadstate.core import InputError
from roadstate.core import numerics as numerics  # float64 before the first array

_FINE = 0.25  # m between the places at which plan and travelled distance are matched


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

    @classmethod
    def in_plan(cls, distance: ArrayLike, grade: ArrayLike, start_altitude: float = 0.0) -> Self:
        """The profile whose knots lie at these lengths of the road's plan view, as a map shows them.

        The plan shortens a section by the mean of cos θ, which its length does not change.

        Args:
            distance: (K,) of the knots in plan view, increasing, m; the first stays where it is.
            grade: (K,) at the knots, rad.
            start_altitude: height at the first knot, m.

        Raises:
            InputError: as for the class.
        """
        plan = np.atleast_1d(np.asarray(distance, float))
        profile = cls(plan, grade, start_altitude)  # refuses what is wrong
        _, shortening = _plan_sections(profile)
        travelled = plan[0] + np.concatenate([[0.0], np.cumsum(np.diff(plan) / shortening)])
        return cls(travelled, grade, start_altitude)

    def over_plan(self, s: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Height (m) and tan θ at lengths ``s`` of the plan view, (N,), m, s = 0 at distance 0."""
        low, high = min(0.0, float(self._distance[0])), float(self._distance[-1])
        fine = np.linspace(low, high, max(2, int((high - low) / _FINE) + 2))
        middle = np.sqrt(1 - self._evaluate((fine[1:] + fine[:-1]) / 2, np)[1] ** 2)
        ends = np.sqrt(1 - self._evaluate(fine, np)[1] ** 2)
        # Simpson's rule in each panel
        plan = np.concatenate([[0.0], np.cumsum(np.diff(fine) * (ends[1:] + 4 * middle + ends[:-1]) / 6)])
        plan -= np.interp(0.0, fine, plan)
        travelled = np.interp(s, plan, fine)
        travelled += np.minimum(s - plan[0], 0) / ends[0] + np.maximum(s - plan[-1], 0) / ends[-1]
        height, sine = self._evaluate(travelled, np)
        return height, sine / np.sqrt(1 - sine**2)

    def grade(self, s: ArrayLike | Float[Array, " *S"]) -> Float[Array, " *S"]:
        """Grade angle θ in rad at distance ``s`` (any shape, m)."""
        grade: Float[Array, " *S"] = jnp.arcsin(self._evaluate(s, jnp)[1])
        return grade

    def altitude(self, s: ArrayLike | Float[Array, " *S"]) -> Float[Array, " *S"]:
        """Height in m at distance ``s`` (any shape, m)."""
        height: Float[Array, " *S"] = self._evaluate(s, jnp)[0]
        return height

    def _evaluate(self, s: Any, xp: Any) -> tuple[Any, Any]:
        """Height and sin θ, computed by ``jax.numpy`` or, without its compiler, by ``numpy``."""
        place, sine, knots = xp.asarray(s), xp.asarray(self._sine), xp.asarray(self._distance)
        last = len(knots) - 1
        i = xp.clip(xp.searchsorted(knots, place, side="right") - 1, 0, max(last - 1, 0))
        after = xp.minimum(i + 1, last)
        length = knots[after] - knots[i]  # 0 where the road is a single knot
        u = xp.clip((place - knots[i]) / xp.where(length > 0, length, 1.0), 0.0, 1.0)
        a, b = sine[i], sine[after]
        within = length * ((a + b) / 2 * u - (b - a) / (2 * xp.pi) * xp.sin(xp.pi * u))
        outside = xp.minimum(place - knots[0], 0.0) * sine[0] + xp.maximum(place - knots[-1], 0.0) * sine[-1]
        height = xp.asarray(self._altitude)[i] + within + outside
        return height, a + (b - a) * (1 - xp.cos(xp.pi * u)) / 2


def _plan_sections(profile: GradeProfile) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(K − 1,) lengths of the sections, and mean of cos θ over each."""
    sine = np.asarray(profile._sine)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    within = sine[:-1, None] + np.diff(sine)[:, None] * (1 - np.cos(np.pi * (nodes + 1) / 2)) / 2
    return np.diff(np.asarray(profile._distance)), np.sqrt(1 - within**2) @ weights / 2


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
