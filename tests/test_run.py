"""Scan and stream on an estimator so simple that its results are known: an odometer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import Estimates, InputError, Log
from roadstate.run import CHUNK, Stream, batch, chunk, scan
from run.odometer import Odometer

NAN = np.nan


def make_log(samples: int, seed: int = 0) -> Log:
    random = np.random.default_rng(seed)
    time = 100 + np.cumsum(random.uniform(0.001, 0.02, samples))
    speed = np.where(random.random(samples) < 0.1, NAN, random.normal(5, 5, samples))
    return Log(time, {"speed": speed}, {"files": ["a.csv"]})


def expected(log: Log) -> np.ndarray:
    return np.cumsum(np.nan_to_num(log["speed"]) * np.diff(log.time, prepend=log.time[0]))


@pytest.mark.parametrize("samples", [1, 2, 300, CHUNK - 1, CHUNK, CHUNK + 1, 2 * CHUNK + 77])
def test_a_log_of_any_length(samples: int) -> None:
    log = make_log(samples)
    estimates = scan(Odometer(), log)
    assert estimates.time is log.time
    np.testing.assert_allclose(estimates.values["altitude"], expected(log), rtol=1e-12)
    # one step for each sample, none for what fills up a chunk
    np.testing.assert_array_equal(estimates.std["altitude"], 2 + np.arange(samples))
    np.testing.assert_array_equal(estimates.innovation[:, 0], log["speed"])
    np.testing.assert_array_equal(estimates.innovation_std, 2.0)


def test_a_run_of_many_samples_is_compiled_to_go_faster(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunk, "SHORT", 300)
    fast, gone = chunk.steps_through(301), []
    monkeypatch.setattr(chunk, "_WHOLE", lambda *args: gone.append(args[5]) or fast(*args))
    estimates = scan(Odometer(), make_log(300))
    assert not gone
    np.testing.assert_array_equal(
        scan(Odometer(), make_log(300), among=301).values["altitude"], estimates.values["altitude"]
    )
    batch(Odometer(), [make_log(150), make_log(151)])
    assert sorted(gone) == [150, 151, 300]


def test_the_nis_is_that_of_the_sensors_used() -> None:
    """A sample that was missing or refused has no NIS, not one of zero."""
    log = Log(np.arange(5.0), {"speed": np.array([3.0, NAN, -3.0, 0.0, 2.0])})
    np.testing.assert_array_equal(scan(Odometer(), log).nis, [9, NAN, NAN, NAN, 4])


def test_metadata_says_where_it_comes_from() -> None:
    log = Log(np.arange(4.0), {"speed": np.array([1.0, -2, -3, NAN])}, {"files": ["a.csv"], "vehicle": "suv"})
    metadata = scan(Odometer(), log).metadata
    assert metadata["estimator"] == "odometer"
    assert metadata["rejected"] == {"speed": 2}
    assert metadata["log"] == {"files": ["a.csv"], "vehicle": "suv"}
    assert set(metadata) >= {"roadstate", "jax"}


def test_a_channel_that_the_log_lacks_is_missing() -> None:
    log = Log(np.arange(3.0), {"yaw_rate": np.ones(3)})
    estimates = scan(Odometer(), log)
    np.testing.assert_array_equal(estimates.values["altitude"], 0)
    assert np.isnan(estimates.innovation).all()


def test_progress_is_told_after_each_chunk() -> None:
    told: list[tuple[int, int]] = []
    total = 2 * CHUNK + 5
    scan(Odometer(), make_log(total), progress=lambda done, of: told.append((done, of)))
    assert told == [(CHUNK, total), (2 * CHUNK, total), (total, total)]


def test_parameters_are_the_estimators_own() -> None:
    log = make_log(50)
    double = scan(Odometer(gain=jnp.asarray(2.0)), log)
    np.testing.assert_allclose(double.values["altitude"], 2 * expected(log))


@pytest.mark.parametrize("run_over", [scan, lambda e, log: batch(e, [log])])
def test_what_is_no_log_is_refused(run_over: Any) -> None:
    with pytest.raises(InputError, match=r"^a log that is a dict; give a Log\(time, \{channel: values\}\)$"):
        run_over(Odometer(), {"time": [0.0, 1.0], "speed": [1.0, 2.0]})


def test_results_survive_a_file(tmp_path: Path) -> None:
    estimates = scan(Odometer(), make_log(40))
    back = Estimates.from_parquet(estimates.to_parquet(tmp_path / "e.parquet"))
    np.testing.assert_array_equal(back.values["altitude"], estimates.values["altitude"])
    np.testing.assert_array_equal(back.nis, estimates.nis)
    assert back.metadata == estimates.metadata


class TestStream:
    def test_is_the_scan(self) -> None:
        log = make_log(100)
        estimates, stream = scan(Odometer(), log), Stream(Odometer())
        assert stream.time is None
        for k, time in enumerate(log.time):
            estimate = stream.push(time, {"speed": log["speed"][k], "brake": 1.0})
            assert float(estimate.values["altitude"]) == estimates.values["altitude"][k]
            assert float(estimate.std["altitude"]) == estimates.std["altitude"][k]
        assert stream.time == log.time[-1]

    def test_a_saved_state_goes_on_bit_for_bit(self) -> None:
        log = make_log(60)
        whole, first = Stream(Odometer()), Stream(Odometer())
        for k in range(30):
            whole.push(log.time[k], {"speed": log["speed"][k]})
            first.push(log.time[k], {"speed": log["speed"][k]})
        second = Stream(Odometer())
        second.state, second.time = {k: np.array(v) for k, v in first.state.items()}, first.time
        for k in range(30, 60):
            a = whole.push(log.time[k], {"speed": log["speed"][k]})
            b = second.push(log.time[k], {"speed": log["speed"][k]})
            assert a.values["altitude"] == b.values["altitude"]
        for kind, vector in whole.state.items():
            np.testing.assert_array_equal(vector, second.state[kind])

    def test_what_is_absent_is_missing(self) -> None:
        stream = Stream(Odometer())
        for time, sample in enumerate(({"speed": 2.0}, {}, {"speed": NAN}, {"speed": 3.0})):
            estimate = stream.push(float(time), sample)
        assert float(estimate.values["altitude"]) == 3.0

    def test_a_name_that_is_no_channel_is_refused_and_changes_nothing(self) -> None:
        stream = Stream(Odometer())
        for time in (1.0, 2.0):  # no longer silent the second time
            with pytest.raises(InputError, match=r"'sped' is not a canonical channel; did you mean 'speed'"):
                stream.push(time, {"speed": 1.0, "sped": 13.9})
        with pytest.raises(InputError, match="'5' is not a canonical channel"):
            stream.push(1.0, {5: 1.0})  # type: ignore[dict-item]
        assert stream.time is None
        assert stream.counts.total() == 0
        stream.push(1.0, {"speed": 1.0, "altitude": 3.0, "ref_grade": 0.1})  # which it does not use

    @pytest.mark.parametrize("time", [5.0, 4.999, -1.0, NAN, np.inf])
    def test_time_must_go_on(self, time: float) -> None:
        stream = Stream(Odometer())
        stream.push(5.0, {"speed": 1.0})
        before = {k: np.array(v) for k, v in stream.state.items()}
        says = "does not come after 5.0 s; push in time order" if np.isfinite(time) else "give a finite time"
        with pytest.raises(InputError, match=f"sample at .* s.*{says}"):
            stream.push(time, {"speed": 1.0})
        assert stream.time == 5.0
        for kind, vector in before.items():
            np.testing.assert_array_equal(stream.state[kind], vector)

    def test_the_first_time_must_be_one(self) -> None:
        with pytest.raises(InputError, match="sample at nan s"):
            Stream(Odometer()).push(NAN, {})
