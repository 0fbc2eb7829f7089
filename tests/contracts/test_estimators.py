"""What every estimator must do: a file under ``roadstate/estimators`` that defines one is held to it."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contracts.plausible import GRADE, mirrored, plausible_log, reflected
from roadstate.core import CHANNELS, QUANTITIES, Estimates, InputError, Log, Validity, is_bound
from roadstate.core.numerics import loop_options
from roadstate.estimators import Estimator, all_estimators, build, runnable
from roadstate.io.plausible import limit_of
from roadstate.run import CHUNK, Stream, scan
from roadstate.vehicles import Vehicle, load_vehicle

NAN = np.nan
STEPS = 1280  # 10 s at 128 Hz
ESTIMATORS = all_estimators()
MEASURED = {n for n, c in CHANNELS.items() if not c.is_reference and n != "time"}


def declared(kind: type[Estimator[Any]]) -> set[str]:
    """Every channel that the class says it may read."""
    return {c for need in kind.needs for group in need.alternatives for c in group} | set(kind.optional)


def ways(kind: type[Estimator[Any]]) -> Iterator[frozenset[str]]:
    """Every set of channels that meets the needs, one alternative for each need."""
    for groups in itertools.product(*(need.alternatives for need in kind.needs)):
        yield frozenset(itertools.chain.from_iterable(groups))


class Case(NamedTuple):
    """An estimator built for the fewest channels that do, or for all it may read."""

    estimator: Estimator[Any]
    log: Log
    usual: Estimates


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return load_vehicle("family-car")


@pytest.fixture(scope="module")
def drive(vehicle: Vehicle) -> Log:
    return plausible_log(vehicle, STEPS)


@pytest.fixture(scope="module", params=[f"{name}-{how}" for name in ESTIMATORS for how in ("few", "all")])
def case(request: pytest.FixtureRequest, vehicle: Vehicle, drive: Log) -> Case:
    name, _, how = request.param.rpartition("-")
    kind = ESTIMATORS[name]
    estimator = build(name, vehicle, next(ways(kind)) if how == "few" else declared(kind))
    log = drive.select([*estimator.channels, "ref_grade"])
    return Case(estimator, log, scan(estimator, log))


# what takes a program of its own to compile is asked of the one that reads all channels
all_channels = pytest.mark.parametrize("case", [f"{name}-all" for name in ESTIMATORS], indirect=True)


def same(a: Estimates, b: Estimates, tolerance: float = 0.0) -> None:
    for x, y in zip(jax.tree.leaves(parts(a)), jax.tree.leaves(parts(b)), strict=True):
        if tolerance:
            np.testing.assert_allclose(x, y, rtol=tolerance, atol=tolerance)
        else:
            np.testing.assert_array_equal(x, y)


def parts(e: Estimates) -> Any:
    return dict(e.values), dict(e.std), e.validity, e.innovation, e.innovation_std, e.nis


def unbounded(names: Iterable[str]) -> set[str]:
    """What has a standard deviation of its own."""
    return {n for n in names if not is_bound(n)}


def sound(estimates: Estimates) -> None:
    """Whatever came in, what goes out are numbers and positive standard deviations."""
    for name, values in estimates.values.items():
        assert np.isfinite(values).all(), name
        if is_bound(name):
            quantity, side = name.rsplit("_", 1)
            away = values - estimates.values[quantity]
            assert (away <= 0 if side == "lower" else away >= 0).all(), name
            continue
        assert np.isfinite(estimates.std[name]).all(), name
        assert (estimates.std[name] > 0).all(), name
    assert set(estimates.validity) <= {int(v) for v in Validity}


def emptied(log: Log, rows: slice = slice(None), value: float = NAN) -> Log:
    """The log with every channel set to a value in some rows."""
    channels = {n: v.copy() for n, v in log.channels.items()}
    for values in channels.values():
        values[rows] = value
    return Log(log.time, channels)


def built_or_refused(name: str, vehicle: Vehicle, available: frozenset[str]) -> Estimator[Any] | None:
    """The estimator, or nothing where the channels would do but not for this car, which the message names."""
    try:
        return build(name, vehicle, available)
    except InputError as refusal:
        if "vehicle" not in str(refusal):
            raise
        return None


class TestDeclaration:
    @pytest.fixture(params=ESTIMATORS)
    def kind(self, request: pytest.FixtureRequest) -> type[Estimator[Any]]:
        return ESTIMATORS[request.param]

    def test_names_and_channels_are_canonical(self, kind: type[Estimator[Any]]) -> None:
        assert kind.name == kind.name.lower().strip()
        assert kind.summary
        assert "\n" not in kind.summary
        assert kind.needs
        assert declared(kind) <= MEASURED
        assert all(need.what and need.alternatives for need in kind.needs)

    def test_builds_for_every_way_to_meet_its_needs(
        self, kind: type[Estimator[Any]], vehicle: Vehicle
    ) -> None:
        built = 0
        for channels in ways(kind):
            assert kind.name in runnable(channels)
            for available in (channels, channels | set(kind.optional), MEASURED):
                if (estimator := built_or_refused(kind.name, vehicle, available)) is None:
                    continue
                built += 1
                assert set(estimator.channels) <= available & declared(kind)
                assert len(set(estimator.channels)) == len(estimator.channels)
                assert len(set(estimator.sensors)) == len(estimator.sensors) > 0
        assert built > 0

    def test_says_what_is_missing(self, kind: type[Estimator[Any]], vehicle: Vehicle) -> None:
        for need in kind.needs:
            available = MEASURED - {c for group in need.alternatives for c in group}
            assert kind.name not in runnable(available)
            with pytest.raises(InputError, match=f"^'{kind.name}' needs .*{need.what} ") as refusal:
                build(kind.name, vehicle, available)
            assert "+".join(need.alternatives[0]) in str(refusal.value)
            assert (", ".join(runnable(available)) or "none") in str(refusal.value)

    def test_before_the_first_sample(self, kind: type[Estimator[Any]], vehicle: Vehicle) -> None:
        estimator = build(kind.name, vehicle, MEASURED)
        estimate = eqx.filter_jit(lambda: estimator.estimate(estimator.init()))()
        assert unbounded(estimate.values) == set(estimate.std) <= set(QUANTITIES)
        assert all(np.isfinite(v) for v in estimate.values.values())
        assert all(np.isfinite(s) and s > 0 for s in estimate.std.values())
        assert estimate.validity == Validity.SENSOR_MISSING


def test_an_unknown_estimator_is_refused(vehicle: Vehicle) -> None:
    with pytest.raises(InputError, match="no estimator is called 'kmeb'; did you mean 'kmbe'"):
        build("kmeb", vehicle, MEASURED)


def test_shapes_and_quantities(case: Case) -> None:
    e, m = case.usual, len(case.estimator.sensors)
    assert unbounded(e.values) == set(e.std) <= set(QUANTITIES)
    assert set(e.values) <= set(QUANTITIES)
    assert e.sensors == case.estimator.sensors
    assert e.innovation.shape == e.innovation_std.shape == (STEPS, m)
    assert e.nis.shape == e.validity.shape == (STEPS,)
    assert e.metadata["estimator"] == case.estimator.name
    sound(e)


def test_every_sensor_has_a_unit(case: Case) -> None:
    assert set(case.usual.sensor_units) == set(case.estimator.sensors)
    assert set(case.usual.sensor_units.values()) <= {c.unit for c in CHANNELS.values()}


def test_finds_a_constant_grade(case: Case) -> None:
    if "grade" not in case.usual.values:
        pytest.skip("gives no grade")
    late = slice(STEPS // 2, None)
    error = np.abs(case.usual.values["grade"] - GRADE)[late]
    assert error.max() < 0.015
    assert (error < 3 * case.usual.std["grade"][late]).all()
    known = [Validity.EXCITED]
    if "friction_peak" in case.usual.values:  # which a gentle drive does not tell, while it tells the grade
        known.append(Validity.LOW_EXCITATION)
    assert np.isin(case.usual.validity[late], known).mean() > 0.9


def test_nothing_at_all_is_a_prediction(case: Case) -> None:
    silent = scan(case.estimator, emptied(case.log))
    sound(silent)
    assert (silent.validity == Validity.SENSOR_MISSING).all()
    assert np.isnan(silent.innovation).all()
    assert np.isnan(silent.nis).all()
    if "grade" in silent.values:
        np.testing.assert_allclose(silent.values["grade"], 0, atol=1e-9)


def test_a_gap_widens_the_interval_and_is_told(case: Case) -> None:
    gap = slice(640, 640 + 5 * 128)
    estimates = scan(case.estimator, emptied(case.log, gap))
    sound(estimates)
    assert estimates.validity[gap.stop - 1] == Validity.SENSOR_MISSING
    for name, std in estimates.std.items():
        # a posterior on a grid returns to its prior, which evidence may have widened a little
        least = 0.99 if name.startswith("friction_peak") and "grade" in estimates.values else 1.0
        assert std[gap.stop - 1] > least * std[gap.start - 1], name


@pytest.mark.parametrize("rubbish", [np.inf, -np.inf])
def test_infinite_samples_are_missing(case: Case, rubbish: float) -> None:
    """One sample of every channel at once; the same as none."""
    hit = scan(case.estimator, emptied(case.log, slice(200, 201), rubbish))
    same(hit, scan(case.estimator, emptied(case.log, slice(200, 201))))


@pytest.mark.parametrize("sign", [1, -1])
def test_the_worst_plausible_sample_does_no_lasting_harm(case: Case, sign: int) -> None:
    """Every channel at once at the largest magnitude that a reader lets pass, for one sample."""
    channels = {n: v.copy() for n, v in case.log.channels.items()}
    for name, values in channels.items():
        limit = limit_of(name)
        values[200] = sign * limit.magnitude if limit is not None else values[200]
    hit = scan(case.estimator, Log(case.log.time, channels))
    sound(hit)
    late = slice(-128, None)
    assert (hit.validity[late] == case.usual.validity[late]).all()
    for name in hit.std:
        away = np.abs(hit.values[name] - case.usual.values[name])[late]
        assert (away < 3 * (hit.std[name] + case.usual.std[name])[late]).all(), name


def test_a_stream_gives_the_numbers_of_a_scan(case: Case) -> None:
    stream = Stream(case.estimator)
    off = 1e-6 if case.estimator.name == "joint" else 1e-12  # it weighs friction in single precision
    count = 200
    for k in range(count):
        if k == 100:  # saved and put back
            saved = {kind: np.array(vector) for kind, vector in stream.state.items()}, stream.time
            stream = Stream(case.estimator)
            stream.state, stream.time = saved
        estimate = stream.push(case.log.time[k], {n: v[k] for n, v in case.log.channels.items()})
        for got, expected in ((estimate.values, case.usual.values), (estimate.std, case.usual.std)):
            for name in expected:
                assert float(got[name]) == pytest.approx(expected[name][k], rel=off, abs=min(off, 1e-8))
        assert int(estimate.validity) == case.usual.validity[k]


def test_the_start_of_time_does_not_matter(case: Case) -> None:
    same(case.usual, scan(case.estimator, Log(case.log.time + 2.0**20, case.log.channels)))


def test_the_order_of_columns_does_not_matter(case: Case) -> None:
    same(case.usual, scan(case.estimator, case.log.select(reversed(list(case.log.channels)))))


def test_left_and_right_do_not_matter(case: Case) -> None:
    """Also where one side is missing: then the other one in the mirror is."""
    holes = {
        n: np.where(np.arange(STEPS) % 7 < 2, NAN, v) if n.endswith("_fl") else v
        for n, v in case.log.channels.items()
    }
    log = Log(case.log.time, holes)
    a, b = scan(case.estimator, log), scan(case.estimator, mirrored(log))
    if set(mirrored(log).channels) != set(log.channels):
        pytest.skip("reads one side only")
    same(reflected(a), b, 1e-6)  # samples taken one after the other leave a trace of their order


def test_references_are_not_read(case: Case) -> None:
    lied = case.log.with_channels({"ref_grade": np.full(STEPS, 0.5)})
    same(case.usual, scan(case.estimator, lied))


@pytest.fixture
def compilations(caplog: pytest.LogCaptureFixture) -> Iterator[list[str]]:
    """What is compiled while the fixture lives."""
    with caplog.at_level(logging.WARNING, "jax"), jax.log_compiles():
        found: list[str] = []
        caplog.handler.emit = lambda record: found.append(record.getMessage())  # type: ignore[method-assign]
        yield found


def test_one_program_runs_every_log_and_every_car(
    case: Case, vehicle: Vehicle, compilations: list[str]
) -> None:
    # as a program may compute it: a number of NumPy's
    heavier = vehicle.model_copy(update={"mass": np.float64(1.2 * vehicle.mass)})
    other = build(case.estimator.name, heavier, case.estimator.channels)
    stream, restarted = Stream(case.estimator), Stream(other)
    first = {n: v[0] for n, v in case.log.channels.items()}
    stream.push(0.0, first)
    stream.push(0.1, {})
    compilations.clear()
    for length in (1, 700, 2 * CHUNK + 1):
        scan(other, plausible_log(heavier, length).select(case.estimator.channels))
    restarted.push(5.0, first)
    for k in range(3):
        stream.push(k + 1.0, first)
    assert [message for message in compilations if message.startswith("Compiling")] == []


def test_the_counter_of_compilations_counts(compilations: list[str]) -> None:
    jax.jit(lambda x: x * 12345.678)(jnp.zeros(3))
    assert any(message.startswith("Compiling") for message in compilations)


@all_channels
def test_cars_and_logs_form_a_batch(case: Case, vehicle: Vehicle) -> None:
    """Parameters are leaves: two cars on two logs in one vectorised run are the two runs by themselves."""
    heavier = build(
        case.estimator.name, vehicle.model_copy(update={"mass": 1.2 * vehicle.mass}), case.estimator.channels
    )
    logs = [case.log, mirrored(case.log).with_channels({c: case.log[c] for c in case.estimator.channels})]
    logs[1] = emptied(logs[1], slice(50, 60))
    count = 100
    arrays, static = eqx.partition(case.estimator, eqx.is_array)
    arrays = jax.tree.map(lambda a, b: jnp.stack([a, b]), arrays, eqx.partition(heavier, eqx.is_array)[0])
    samples = {c: jnp.stack([log[c][:count] for log in logs]) for c in case.estimator.channels}
    dt = jnp.asarray(np.diff(case.log.time[:count], prepend=0.0))

    @jax.jit
    @jax.vmap
    def together(arrays: Any, samples: Any) -> Any:
        estimator = eqx.combine(arrays, static)

        def body(state: Any, row: Any) -> tuple[Any, Any]:
            state, _ = estimator.step(state, *row)
            return state, estimator.estimate(state)

        return jax.lax.scan(body, estimator.init(), (samples, dt))[1]

    both = together(arrays, samples)
    # where a part works in single precision, two programs for the same differ by its last digits
    rtol = 1e-5 if any(leaf.dtype == np.float32 for leaf in jax.tree.leaves(arrays)) else 1e-8
    for i, (estimator, log) in enumerate(zip((case.estimator, heavier), logs, strict=True)):
        alone = scan(estimator, log)
        for got, expected in ((both.values, alone.values), (both.std, alone.std)):
            for name in expected:
                np.testing.assert_allclose(got[name][i], expected[name][:count], rtol=rtol, atol=rtol / 10)


@all_channels
def test_derivatives_are_finite(case: Case) -> None:
    """Along 50 steps, the first of no time, some of no sample: by every parameter and by the state."""

    def typed(state: Any) -> Any:
        # a number that comes from one of Python's has a type of its own to JAX: and so another program
        return jax.tree.map(lambda leaf: jnp.asarray(leaf, leaf.dtype), state)

    # run fifty times, so what counts is how fast it compiles
    @partial(eqx.filter_jit, compiler_options=loop_options())
    @eqx.filter_grad(has_aux=True)
    def gradient(at: Any, sample: Any, dt: Any) -> tuple[Any, Any]:
        estimator, state = at
        new, info = estimator.step(state, sample, dt)
        estimate = estimator.estimate(new)
        value = sum(estimate.values.values()) + sum(estimate.std.values())
        return value + info.log_likelihood + info.nis, typed(new)

    state, size = typed(case.estimator.init()), 0.0
    for k in range(50):
        sample = {c: np.float64(NAN if k % 9 == 8 else case.log[c][k]) for c in case.estimator.channels}
        slopes, state = gradient(
            (case.estimator, state), sample, np.float64(0.0 if k in (0, 20) else 1 / 128)
        )
        for path, leaf in jax.tree_util.tree_leaves_with_path(slopes):
            assert np.isfinite(leaf).all(), f"step {k}: {jax.tree_util.keystr(path)}"
        size += sum(float(np.abs(leaf).sum()) for leaf in jax.tree.leaves(slopes[0]))
    assert size > 0


@all_channels
def test_single_precision(case: Case, vehicle: Vehicle) -> None:
    with jax.enable_x64(False):
        estimator = build(case.estimator.name, vehicle, case.estimator.channels)
        assert {str(leaf.dtype) for leaf in jax.tree.leaves(estimator) if eqx.is_inexact_array(leaf)} == {
            "float32"
        }
        single = scan(estimator, case.log)
        silent = scan(estimator, emptied(case.log))
    sound(single)
    sound(silent)
    assert (single.validity == case.usual.validity).mean() > 0.98
    if "grade" in single.values:
        np.testing.assert_allclose(single.values["grade"], case.usual.values["grade"], atol=1e-3)
        np.testing.assert_allclose(single.std["grade"], case.usual.std["grade"], rtol=0.02)
