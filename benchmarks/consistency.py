"""Are the filters' uncertainties honest? ``python -m benchmarks.consistency`` prints a row for every filter.

With ``--all`` also other settings, wrong noise, a joint road, one sharp sample, and what a step costs. Run it
from the project's root.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from tests.filters.models import run, simulate
from tests.oracles.filter_models import Friction, Radar, drive

from roadstate.consistency import nees, nees_test, nis_test
from roadstate.filters import (
    EKF,
    UKF,
    AdaptiveEKF,
    AdaptiveUKF,
    Bounded,
    ExtendedHInfinity,
    Filter,
    Forgetting,
    FuzzyNoise,
    IteratedEKF,
    LimitedMemoryEKF,
    StrongTracking,
    all_filters,
)
from roadstate.filters.imm import IMM
from roadstate.filters.particle import ParticleFilter
from roadstate.filters.rao_blackwell import RaoBlackwellPF
from roadstate.filters.switching import SwitchingModel

_SEEDS = 200
_STEPS, _SETTLED = 120, 60
_COLUMNS = "NEES / n | instants in the band, % | NEES | NIS / m | position RMSE, m"
_NOTES = {
    "h-infinity": "its P bounds the worst case, it is no covariance",
    "particle": "too few particles for four states that the sensors determine",
    "rao-blackwell": "too few particles",
}
_PLAIN = {"ekf": EKF(), "iekf": IteratedEKF(), "ukf": UKF()}
_LEARN = {
    "adaptive-ekf": AdaptiveEKF(),
    "adaptive-ukf": AdaptiveUKF(),
    "adaptive-ekf, paper's form": AdaptiveEKF(centered=False),
    "adaptive-ekf, Sage–Husa b = 0.98": AdaptiveEKF(average=Forgetting(0.98)),
    "adaptive-ekf, innovation, floor 0.1": AdaptiveEKF(statistic="innovation", floor=0.1),
    "adaptive-ekf, innovation, floor 0.01": AdaptiveEKF(statistic="innovation"),
}
_LIMITED = {
    "lm-aekf": LimitedMemoryEKF(),
    "lm-aekf, memory alone": LimitedMemoryEKF(fading=None, fuzzy=None),
    "lm-aekf, fading alone": LimitedMemoryEKF(memory=None, fading=StrongTracking(), fuzzy=None),
    "lm-aekf, fuzzy alone": LimitedMemoryEKF(memory=None, fading=None, fuzzy=FuzzyNoise()),
}
_ROBUST = {f"h-infinity, θ = {theta}": ExtendedHInfinity(theta=theta) for theta in (0.01, 0.1, 1.0)}


class Target(Radar):
    """:class:`Radar`, which says that only the position is seen through curved sensors."""

    @property
    def nonlinear(self) -> tuple[str, ...]:
        return ("p_x", "p_y")


def jumping(world: SwitchingModel, u: Any, dt: Any, key: Any) -> tuple[Any, Any]:
    """States and samples of a world whose law changes by its own chain."""
    arrays, rest = eqx.partition(world.modes, eqx.is_array)
    for_mode, for_start, for_steps = jax.random.split(key, 3)
    prior = world.prior()
    x = prior.mean + prior.factor @ jax.random.normal(for_start, prior.mean.shape)

    def body(now: Any, row: Any) -> tuple[Any, Any]:
        (x, mode), (u, dt, key) = now, row
        for_jump, for_w, for_v = jax.random.split(key, 3)
        mode = jax.random.categorical(for_jump, jnp.log(world.transition(dt)[mode]))
        law = eqx.combine(jax.tree.map(lambda leaf: leaf[mode], arrays), rest)
        x = law.f(x, u, dt) + law.sqrt_Q(u, dt) @ jax.random.normal(for_w, x.shape)
        return (x, mode), (x, law.h(x, u) + law.sqrt_R(u) @ jax.random.normal(for_v, (len(law.sensors),)))

    first = jax.random.categorical(for_mode, jnp.log(world.probability))
    return jax.lax.scan(body, (x, first), (u, dt, jax.random.split(for_steps, len(dt))))[1]


@eqx.filter_jit
def _runs(method: Filter[Any], model: Any, world: Any) -> tuple[Any, Any, Any]:
    """Errors (seeds, T, n), factors and NIS (seeds, T) of 12 s."""
    u, dt = jnp.zeros(_STEPS), jnp.full(_STEPS, 0.1)
    draw = partial(jumping if isinstance(world, SwitchingModel) else simulate, world, u, dt)

    def one(key: Any) -> tuple[Any, Any, Any]:
        x, z = draw(key)
        posteriors, infos, _ = run(method, model, u, z, dt)
        return posteriors.mean - x, posteriors.factor, infos.nis

    return jax.vmap(one)(jax.random.split(jax.random.PRNGKey(0), _SEEDS))


def tracked(method: Filter[Any], model: Any, world: Any) -> tuple[Any, ...]:
    """NEES/n, share of instants (%) in its band, verdict, NIS/m and position RMSE, all from 6 s on."""
    error, factor, nis = (np.asarray(a)[:, _SETTLED:] for a in _runs(method, model, world))
    squared = nees(error, factor)
    test, innovations = nees_test(squared, 4), nis_test(nis, 2)
    rmse = np.sqrt(np.mean(np.sum(error[..., :2] ** 2, axis=-1)))
    share = 100 * np.mean(test.inside)
    verdict = "inside" if share >= 85 else "above" if np.mean(test.value) > 1 else "below"
    return np.mean(squared) / 4, share, verdict, innovations.value, rmse


@eqx.filter_jit
def sharp(method: Filter[Any], model: Any) -> tuple[Any, Any]:
    """NEES/n and position RMSE after one sample."""

    def one(key: Any) -> tuple[Any, Any]:
        for_x, for_v = jax.random.split(key)
        prior = model.prior()
        x = prior.mean + prior.factor @ jax.random.normal(for_x, (4,))
        z = model.h(x, None) + model.sqrt_R(None) @ jax.random.normal(for_v, (2,))
        posterior = method.posterior(method.update(model, method.init(model), None, z)[0])
        error = x - posterior.mean
        return jnp.sum(jnp.linalg.solve(posterior.factor, error) ** 2), jnp.sum(error[:2] ** 2)

    nees, square = jax.vmap(one)(jax.random.split(jax.random.PRNGKey(0), 2000))
    return jnp.mean(nees) / 4, jnp.sqrt(jnp.mean(square))


@eqx.filter_jit
def joined(method: Filter[Any]) -> tuple[Any, Any, Any]:
    """RMSE of the mean friction 1 s before, 0.5 to 1 s after and 3 to 4 s after it jumps from 0.2 to 0.8."""
    steps, jump = 700, 300
    u, dt = jnp.asarray(drive(steps, 0.01, 1.0)), jnp.full(steps, 0.01)
    truth = jnp.where(jnp.arange(steps) < jump, 0.2, 0.8)
    model = Friction(walk=jnp.asarray(1e-4))

    def one(key: Any) -> Any:
        noise = 0.05 * jax.random.normal(key, (steps, 3))
        z = jnp.einsum("tij,j->ti", u, jnp.ones(4)) * truth[:, None] + noise
        return jnp.mean(run(method, model, u, z, dt)[0].mean, axis=1) - truth

    error = jax.vmap(one)(jax.random.split(jax.random.PRNGKey(0), 100))
    spans = (jump - 100, jump), (jump + 50, jump + 100), (jump + 300, jump + 400)
    before, soon, later = (jnp.sqrt(jnp.mean(error[:, a:b] ** 2)) for a, b in spans)
    return before, soon, later


def cost(method: Filter[Any]) -> tuple[float, float]:
    """Seconds of a first call and µs of a step of :class:`Friction` (4 states, 3 sensors) in one scan."""
    steps = 5000
    u, dt = jnp.asarray(drive(steps, 0.01, 1.0)), jnp.full(steps, 0.01)
    z = jnp.asarray(0.5 + 0.05 * np.random.default_rng(0).normal(size=(steps, 3)))
    start = time.perf_counter()
    scan = jax.jit(lambda u, z, dt: run(method, Friction(), u, z, dt)[0].mean).lower(u, z, dt).compile()
    first, best = time.perf_counter() - start, np.inf
    for _ in range(5):
        start = time.perf_counter()
        jax.block_until_ready(scan(u, z, dt))
        best = min(best, time.perf_counter() - start)
    return first, best / steps * 1e6


def table(title: str, columns: str, rows: Mapping[str, tuple[Any, ...]]) -> None:
    """Print one table."""
    print(f"\n{title}\n\n| filter | {columns} |\n|---|{'---|' * (columns.count('|') + 1)}")
    for name, row in rows.items():
        cells = " | ".join(value if isinstance(value, str) else f"{float(value):.3g}" for value in row)
        print(f"| {name} | {cells} |")


def matched() -> None:
    """Every filter there is as it comes, and some otherwise, on worlds that are as they believe."""
    model = Target()
    every: dict[str, Filter[Any]] = {name: kind() for name, kind in all_filters().items()}
    every["particle, 4000 particles"] = ParticleFilter(particles=4000)
    every["rao-blackwell, 1000 particles"] = RaoBlackwellPF(particles=1000)
    rows = {}
    for name, method in sorted(every.items()):
        row = tracked(method, model, model)
        own = _NOTES.get(name.split(",")[0], "") if row[2] != "inside" else ""
        rows[name] = (*row, own)
    low, high = nees_test(np.ones(_SEEDS), 4)[1:]
    print(
        f"Errors of {_SEEDS} runs of 12 s, judged from 6 s on, against what the filter promised. "
        "At an instant the mean NEES / n of a filter that is right lies between "
        f"{low:.3f} and {high:.3f} with 95 % probability; "
        "`inside` is one for which that holds at 85 % of the instants or more (neighbouring "
        "instants are alike)."
    )
    table("Matched, every filter", _COLUMNS + " | why not", rows)
    calm, wild = Target(accel=0.3), Target(accel=3.0)
    jumps = SwitchingModel.of([calm, wild], 0.3)
    rivals = {"imm": (IMM(), jumps), "ukf, calm mode": (UKF(), calm), "ukf, wild mode": (UKF(), wild)}
    jumped = {name: tracked(method, own, jumps) for name, (method, own) in rivals.items()}
    table("A world that jumps between two accelerations", _COLUMNS, jumped)


def others() -> None:
    """Other settings and other worlds."""
    model = Radar()
    settings = {**_ROBUST, **_LEARN, **_LIMITED}
    table("Matched, other settings", _COLUMNS, {n: tracked(f, model, model) for n, f in settings.items()})
    learners = {"ekf": EKF(), **_LEARN, "lm-aekf, fuzzy alone": _LIMITED["lm-aekf, fuzzy alone"]}
    for title, factor in (("Noise taken for three times", 3.0), ("Noise taken for a third", 1 / 3)):
        wrong = Radar(range_std=1.0 * factor, bearing_std=0.01 * factor)
        table(f"{title} what it is", _COLUMNS, {n: tracked(f, wrong, model) for n, f in learners.items()})
    curved = Radar(std=(15.0, 15.0, 1.0, 1.0), range_std=0.1, bearing_std=0.001)
    table("One sharp sample", "NEES / n | position RMSE, m", {n: sharp(f, curved) for n, f in _PLAIN.items()})
    joint = {"ekf": EKF(), **_ROBUST, **_LEARN, **_LIMITED}
    table("Joint road", "before | 0.5–1 s after | 3–4 s after", {n: joined(f) for n, f in joint.items()})
    costly: dict[str, Filter[Any]] = {name: kind() for name, kind in all_filters().items()}
    costly["bounded"] = Bounded(EKF(), lower=0.0, upper=1.2)
    costly |= {**_ROBUST, **_LEARN, **_LIMITED, "lm-aekf, memory 200": LimitedMemoryEKF(memory=200)}
    table("Cost", "first call, s | step, µs", {n: cost(f) for n, f in sorted(costly.items())})


def main() -> None:
    """Print the tables asked for."""
    print("# Consistency of the filters\n\nMade by `python -m benchmarks.consistency`.\n", flush=True)
    matched()
    if "--all" in sys.argv[1:]:
        others()


if __name__ == "__main__":
    main()
