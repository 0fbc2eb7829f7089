"""Traced programs are kept on disk, and found again only where nothing they depend on has changed."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.calibration import scores
from roadstate.core import Estimates, Log, traced
from roadstate.core.numerics import jit_loop
from roadstate.estimators import build
from roadstate.estimators.base import Estimator
from roadstate.estimators.kmbe import KMBE
from roadstate.run import chunk, scan
from roadstate.vehicles import load_vehicle

CHANNELS = ("accel_x", "speed")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(traced, "folder", tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def kmbe() -> Estimator[Any]:
    return build("kmbe", load_vehicle("family-car"), CHANNELS)


@pytest.fixture(scope="module")
def log() -> Log:
    time = np.arange(2 * chunk.CHUNK) / 100
    return Log(time, {"accel_x": 0.3 + 0.1 * np.sin(time), "speed": 20.0 + 0.1 * time})


def anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a process that has not run anything yet."""
    apart = partial(chunk.scan_steps, apart=True)
    monkeypatch.setattr(chunk, "_APART", jit_loop(apart, whole=False, kept=True))


def kept(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.traced"))


def alike(one: Estimates, other: Estimates) -> bool:
    return all(np.array_equal(one.values[name], other.values[name]) for name in one.values)


def test_the_next_process_traces_nothing(
    folder: Path, kmbe: Estimator[Any], log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    anew(monkeypatch)
    first = scan(kmbe, log)
    assert len(kept(folder)) == 1
    anew(monkeypatch)
    monkeypatch.setattr(KMBE, "step", lambda *_: pytest.fail("traced"))
    again = scan(kmbe, log)
    assert alike(first, again)
    monkeypatch.undo()
    assert alike(first, scan(kmbe, log))  # as without


def test_what_calibration_keeps_of_a_step_is_found_again(
    folder: Path, kmbe: Estimator[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever asks for other rows than an estimator's own has named tuples of their own."""
    state, layout = chunk.start(kmbe)
    samples, dt = jnp.ones((chunk.CHUNK, len(kmbe.channels))), jnp.full(chunk.CHUNK, 0.01)
    found = []
    for _ in range(2):
        anew(monkeypatch)
        through = chunk.steps_through(10 * chunk.CHUNK)
        found.append(through(kmbe, layout, state, samples, dt, jnp.asarray(5), scores.kept)[1])
        assert len(kept(folder)) == 1
        monkeypatch.setattr(KMBE, "step", lambda *_: pytest.fail("traced"))
    assert isinstance(found[1], scores.Rows)
    np.testing.assert_array_equal(found[0].log_likelihood, found[1].log_likelihood)


def test_a_result_that_nobody_has_named_is_no_error(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Own(NamedTuple):
        value: Any

    monkeypatch.setattr(traced, "_description", lambda *_: "any")
    told = jit_loop(lambda x: Own(2 * x), whole=False, kept=True)(jnp.ones(2))
    np.testing.assert_array_equal(told.value, 2.0)
    assert not kept(folder)


def test_one_program_serves_all_chunks(
    folder: Path, kmbe: Estimator[Any], log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled: list[str] = []

    def listen(event: str, _: float, **told: Any) -> None:
        if event.endswith("backend_compile_duration"):
            compiled.append(str(told.get("fun_name")))

    anew(monkeypatch)
    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        scan(kmbe, log)
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)
    assert sum("call" in name for name in compiled) == 1


def test_what_was_not_written_to_its_end_is_traced_and_kept_again(
    folder: Path, kmbe: Estimator[Any], log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    anew(monkeypatch)
    first = scan(kmbe, log)
    (path,) = kept(folder)
    whole = path.read_bytes()
    for damaged in (whole[:-100], b"", whole[:40] + b"?" + whole[41:]):
        path.write_bytes(damaged)
        anew(monkeypatch)
        assert alike(first, scan(kmbe, log))
        assert len(path.read_bytes()) > 1000
        assert len(list(folder.iterdir())) == 1


def test_other_settings_and_other_channels_are_other_programs(
    folder: Path, kmbe: Estimator[Any], log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    anew(monkeypatch)
    scan(kmbe, log)
    with jax.numpy_rank_promotion("warn"):
        anew(monkeypatch)
        scan(kmbe, log)
    assert len(kept(folder)) == 2
    scan(build("kmbe", load_vehicle("suv"), CHANNELS), log)  # other figures are data
    assert len(kept(folder)) == 2
    scan(build("kmbe", load_vehicle("suv"), (*CHANNELS, "altitude")), log)
    assert len(kept(folder)) == 3
    monkeypatch.setattr(traced, "_versions", lambda: ("another source",))
    anew(monkeypatch)
    scan(kmbe, log)
    assert len(kept(folder)) == 4


def test_what_comes_from_elsewhere_is_not_kept(
    folder: Path, kmbe: Estimator[Any], log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Own(KMBE):
        """A user's."""

    anew(monkeypatch)
    own = Own.build(load_vehicle("family-car"), CHANNELS)
    scan(own, log)
    assert not kept(folder)


def test_a_folder_that_is_gone_is_no_error(
    kmbe: Estimator[Any], log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(traced, "folder", tmp_path / "none")
    anew(monkeypatch)
    assert np.isfinite(scan(kmbe, log).values["grade"]).all()


def test_structures_differ_by_where_their_leaves_are() -> None:
    trees = [(1, (2, 3)), ((1, 2), 3), (1, 2, 3), [1, 2, 3], {"a": 1, "b": (2, 3)}]
    assert len({traced._shape(jax.tree.structure(tree)) for tree in trees}) == len(trees)


def test_a_function_without_a_name_is_told_by_its_place() -> None:
    assert traced._ELSEWHERE in traced._told(lambda: 0)
    assert traced._ELSEWHERE in traced._told((1, partial(alike, 1)))
    assert traced._told(chunk.kept) == "roadstate.run.chunk.kept by kept"


def test_an_array_of_numpys_might_be_in_the_trace_and_so_is_not_told() -> None:
    assert traced._ELSEWHERE in traced._told((1, np.zeros(2)))
    assert traced._ELSEWHERE not in traced._told(jax.numpy.zeros(2))
