"""The peers side by side: all must compute the same thing, or their times mean nothing."""

from __future__ import annotations

import importlib
import json
import shutil
import sys
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from benchmarks.peers import friction, grade, ours, tfobe, with_c
from benchmarks.peers.implementations import FULL, LIBRARIES, PROBLEMS, QUICK, Size, programs
from benchmarks.peers.measure import Truth, measure, truth
from benchmarks.peers.problems import Problem
from benchmarks.peers.program import Program
from benchmarks.peers.reference import Run, first_prior, kalman, particle, reference, unscented
from benchmarks.peers.tables import markdown

_STEPS = 150
_GAUSSIAN = ("tfobe-lower-ukf", "friction-ukf", "kf-2")
_TINY = Size(steps=_STEPS, slow=20, batch=30, logs=3, repeats=2, compared=30, many=4000)
_CLOSE = 1e-8


@cache
def _problem(name: str) -> Problem:
    return PROBLEMS[name][1](_STEPS)


@cache
def _reference(name: str) -> Run:
    return reference(_problem(name))


def _difference(name: str, program: Program) -> float:
    means = program.means(program.call())
    assert means.shape == (program.steps, len(_problem(name).q))
    return float(np.abs(means - _reference(name)[0][: program.steps]).max())


@pytest.mark.parametrize("name", _GAUSSIAN)
def test_c_is_the_reference(name: str) -> None:
    """Means and standard deviations of the hand-written C."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler (cc) on this machine")
    means, stds = with_c.program(_problem(name)).call()
    np.testing.assert_allclose(means, _reference(name)[0], rtol=0, atol=_CLOSE)
    np.testing.assert_allclose(stds, _reference(name)[1], rtol=0, atol=_CLOSE)


@pytest.mark.parametrize("name", _GAUSSIAN)
def test_scan_is_the_reference(name: str) -> None:
    """Our square-root forms, in one compiled loop."""
    assert _difference(name, ours.scan(_problem(name))) < _CLOSE


@pytest.mark.parametrize("name", ["friction-ukf", "kf-2"])
def test_batch_and_stream_are_the_reference(name: str) -> None:
    """The first log of a batch is the problem's own; the others are not."""
    batch = ours.batch(_problem(name).first(30), logs=4)
    assert _difference(name, batch) < _CLOSE
    logs = batch.call()
    assert len(logs) == 4
    assert np.abs(logs[1] - logs[0]).max() > 1e-3
    np.testing.assert_array_equal(batch.call(), logs)  # whichever thread takes which
    stream = ours.stream(_problem(name).first(30))
    assert _difference(name, stream) < _CLOSE
    assert stream.latencies is not None
    latencies = stream.latencies(stream.call())
    assert latencies.shape == (30,)
    assert (latencies > 0).all()


def test_marginal_filter_is_nearly_the_full_one() -> None:
    """Terms of fourth order in the spread: 1e-3 N of forces of kilonewtons, known to tens of newtons."""
    problem = _problem("tfobe-lower-ukf")
    difference = _difference(problem.name, ours.scan(problem, marginal=True))
    assert 0 < difference < 1e-3


def test_the_linear_states_are_linear() -> None:
    """What the marginal filter is told: f and h are affine in the forces, given the velocities."""
    problem = _problem("tfobe-lower-ukf")
    x, y = np.random.default_rng(0).standard_normal((2, len(problem.q))) * problem.std
    y[[i for i in range(len(x)) if i not in problem.linear]] = 0
    u = problem.inputs[100]
    for image in (lambda x: problem.f(np, x, u, problem.dt), lambda x: problem.h(np, x, u)):
        np.testing.assert_allclose(image(x + y) + image(x - y), 2 * image(x), rtol=0, atol=1e-9)


def test_unscented_loop_is_the_kalman_loop_where_all_is_linear() -> None:
    """Two forms of the reference, and the prior that some libraries are given."""
    problem = _problem("kf-2")
    for one, other in zip(unscented(problem), kalman(problem), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-10)
    mean, cov = first_prior(problem)
    F = np.array([[1.0, -problem.dt], [0.0, 1.0]])
    np.testing.assert_allclose(mean, F @ problem.mean + [problem.dt * problem.inputs[0, 0], 0], atol=1e-12)
    np.testing.assert_allclose(cov, F @ np.diag(problem.std**2) @ F.T + np.diag(problem.q**2), atol=1e-12)


def test_particle_filters_differ_by_chance_only() -> None:
    """Over many seeds our errors, against very many particles, are those of the plain loop."""
    problem = friction.problem("pf", 40)
    means = particle(problem, 20_000, seed=1)[0]
    plain = [np.square(particle(problem, seed=seed)[0] - means).mean() for seed in range(2, 10)]
    batch = ours.batch(problem, logs=1)
    one = ours.scan(problem)
    assert np.abs(one.means(one.call()) - means).max() < 6 * np.sqrt(np.mean(plain))
    np.testing.assert_allclose(batch.means(batch.call()), one.means(one.call()), rtol=0, atol=1e-9)


# dynamax adds 1e-9 to the diagonal of S; all others compute what the reference does
_TOLERANCES = {"dynamax": {"friction-ukf": 1e-6, "kf-2": 1e-6}}


@pytest.mark.parametrize("name", ["friction-ukf", "kf-2"])
@pytest.mark.parametrize("library", LIBRARIES)
def test_libraries_are_the_reference(library: str, name: str) -> None:
    """With their prior and parameters set alike."""
    try:
        module = importlib.import_module(f"benchmarks.peers.{LIBRARIES[library].module}")
    except ModuleNotFoundError as error:
        pytest.skip(f"{error.name} is not installed")
    program = module.program(_problem(name).first(30))
    assert _difference(name, program) < _TOLERANCES.get(library, {}).get(name, _CLOSE)


def test_rows_are_json_with_every_key() -> None:
    """What `--json` prints of a problem, and what `--write` makes of it."""
    problem = grade.problem(_STEPS)
    told: list[str] = []
    ready = dict(programs(problem, _TINY, told.append))
    kept = {
        name: ready[name] for name in ("c", "roadstate-scan", "roadstate-stream", "filterpy") if name in ready
    }
    rows = measure(kept, truth(problem, _TINY), _TINY.repeats)
    assert set(rows) == set(kept)
    assert len(told) == sum(name not in ready for name in ("c", *LIBRARIES))
    assert json.loads(json.dumps(rows, allow_nan=False)) == rows
    for name, row in rows.items():
        assert row["us_per_step"] >= row["us_per_step_min"] > 0
        assert row["first_call_s"] > 0
        assert row["max_abs_diff"] < _CLOSE
        assert ("p99_us" in row) == (name == "roadstate-stream")
        assert ("ratio_to_c" in row) == ("c" in rows)
    page = markdown({"kf-2": rows}, 2, "python -m benchmarks.peers")
    assert all(f"| {name} |" in page for name in rows)


def test_what_is_not_there_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """A library that is not installed and a machine without a compiler cost a line, not the run."""
    for name in ("stonesoup", "stonesoup.base"):  # and its parts, which another test may have imported
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "benchmarks.peers.with_stonesoup", raising=False)
    monkeypatch.setenv("PATH", "")
    told: list[str] = []
    ready = dict(programs(friction.problem("pf", 5), _TINY, told.append))
    assert "roadstate-scan" in ready
    assert {"c", "stonesoup"}.isdisjoint(ready)
    assert any(line.startswith("c: left out, no C compiler") for line in told)
    assert any(line.startswith("stonesoup: left out") and "roadstate[peers]" in line for line in told)


def test_what_cannot_be_told_says_why() -> None:
    """A program that stops, and one whose means are no numbers."""

    def stop() -> None:
        raise np.linalg.LinAlgError("not positive definite")

    def lost() -> np.ndarray:
        return np.full((2, 1), np.nan)

    made: dict[str, Callable[[], object]] = {"stops": stop, "lost": lost}
    rows = measure({k: Program(v, np.asarray, 2) for k, v in made.items()}, Truth(np.zeros((2, 1))), 1)
    assert rows["stops"]["us_per_step"] is None
    assert "not positive definite" in rows["stops"]["why_not"]
    assert rows["lost"]["max_abs_diff"] is None
    assert "finite" in rows["lost"]["why_not"]
    assert "it stopped" in markdown({"kf-2": rows}, 1, "")


def test_problems_are_of_the_sizes_told() -> None:
    """15 states and 7 sensors, 11 000 samples; 1000 particles."""
    assert FULL["tfobe-lower-ukf"].steps == 11_000
    assert set(FULL) == set(QUICK) == set(PROBLEMS)
    assert tfobe.problem(3).samples.shape == (3, 7)
    sizes = {name: len(_problem(name).q) for name in PROBLEMS}
    assert sizes == {"tfobe-lower-ukf": 15, "friction-ukf": 4, "friction-pf-1000": 4, "kf-2": 2}
    assert _problem("friction-pf-1000").particles == 1000
