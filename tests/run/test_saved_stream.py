"""A stream saved to a file and gone on with, bit for bit; files that are not one are refused in one line."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from contracts.plausible import plausible_log
from roadstate.core import InputError
from roadstate.estimators import build
from roadstate.run import Arrival, Stream
from roadstate.vehicles import Vehicle, load_vehicle
from run.odometer import Odometer

CHANNELS = ("speed", "accel_x", "yaw_rate")


def kmbe(channels: tuple[str, ...] = CHANNELS, vehicle: Vehicle | None = None) -> Any:
    return build("kmbe", vehicle or load_vehicle("family-car"), channels)


def arriving() -> list[tuple[float, dict[str, float]]]:
    """300 samples, each swapped with a neighbour and now and then in parts."""
    log = plausible_log(load_vehicle("family-car"), 300)
    events = [(float(t), {c: float(log[c][k]) for c in CHANNELS}) for k, t in enumerate(log.time)]
    order = [k + 1 if k % 2 == 0 else k - 1 for k in range(300)]
    return [events[k] for k in order] + [(log.time[280], {"speed": 14.0})]


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    stream = Stream(Odometer(), window=3.0)
    for time in range(6):
        stream.push(float(time), {"speed": 2.0 + time})
    return stream.save(tmp_path / "stream.npz")


@pytest.mark.parametrize("at", [0, 1, 150])
def test_it_goes_on_bit_for_bit_window_included(tmp_path: Path, at: int) -> None:
    events = arriving()
    whole, first, second = (Stream(kmbe(), window=0.5) for _ in range(3))
    for event in events[:at]:
        whole.push(*event)
        first.push(*event)
    second.push(0.0, {})  # what it was before does not matter
    second.restore(first.save(tmp_path / "s.npz"))
    assert second.time == first.time
    for event in events[at:]:
        a, b = whole.push(*event), second.push(*event)
        assert whole.arrival == second.arrival
        assert float(a.values["grade"]) == float(b.values["grade"])
        assert float(a.std["grade"]) == float(b.std["grade"])
    assert whole.counts == second.counts
    assert whole.replaced == second.replaced == 1
    assert whole.counts[Arrival.LATE] == 150
    for kind, vector in whole.state.items():
        np.testing.assert_array_equal(vector, second.state[kind])


def test_the_restored_streams_own_window_holds(saved: Path) -> None:
    narrow = Stream(Odometer(), window=1.0)
    narrow.restore(saved)
    narrow.push(3.5, {"speed": 1.0})
    assert narrow.arrival == Arrival.DROPPED
    small = Stream(Odometer(), window=9.0, capacity=2)
    small.restore(saved)
    assert len(small._steps) == 2
    strict = Stream(Odometer())
    strict.restore(saved)
    with pytest.raises(InputError, match=r"sample at 5.0 s does not come after 5.0 s"):
        strict.push(5.0, {})


def test_another_process_restores_it(saved: Path) -> None:
    """The fingerprint is of the estimator, not of the objects that happen to make it up."""
    program = (
        "import sys; from run.odometer import Odometer; from roadstate.run import Stream\n"
        "s = Stream(Odometer(), window=3.0); s.restore(sys.argv[1]); print(s.time, dict(s.counts))"
    )
    tests = Path(__file__).parent.parent
    done = subprocess.run(
        [sys.executable, "-c", program, str(saved)], capture_output=True, text=True, cwd=tests, check=True
    )
    assert done.stdout.startswith("5.0 ")


def refused(stream: Stream, path: Path, says: str) -> None:
    before = stream.time, {k: np.array(v) for k, v in stream.state.items()}
    with pytest.raises(InputError, match=says) as caught:
        stream.restore(path)
    assert "\n" not in str(caught.value)
    assert stream.time == before[0]
    for kind, vector in before[1].items():
        np.testing.assert_array_equal(stream.state[kind], vector)


class TestAnotherEstimator:
    def test_name(self, saved: Path) -> None:
        refused(Stream(kmbe()), saved, "saved from the estimator 'odometer', not 'kmbe'")

    def test_channels(self, tmp_path: Path) -> None:
        path = Stream(kmbe()).save(tmp_path / "s.npz")
        refused(Stream(kmbe(("speed", "accel_x"))), path, "saved with the channels .*yaw_rate.*, not")

    def test_vehicle(self, tmp_path: Path) -> None:
        path = Stream(kmbe()).save(tmp_path / "s.npz")
        other = kmbe(vehicle=load_vehicle("suv"))
        refused(Stream(other), path, "saved with other parameters; use the same vehicle")

    def test_parameters(self, saved: Path) -> None:
        refused(Stream(Odometer(gain=jnp.asarray(2.0))), saved, "saved with other parameters")

    def test_state(self, saved: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        init = Odometer.init
        monkeypatch.setattr(Odometer, "init", lambda self: (*init(self), jnp.zeros(3)))
        monkeypatch.setattr(Odometer, "name", "odometer")
        refused(Stream(Odometer()), saved, "another shape")


def rewritten(path: Path, **changed: Any) -> Path:
    """The file with arrays changed; ``None`` leaves one out."""
    with np.load(path) as archive:
        arrays = {k: archive[k] for k in archive} | changed
    np.savez(path, **{k: v for k, v in arrays.items() if v is not None})
    return path


class TestDamage:
    def test_no_such_file(self, tmp_path: Path) -> None:
        refused(Stream(Odometer()), tmp_path / "none.npz", r"none\.npz: no such file")

    @pytest.mark.parametrize(
        "changed",
        [
            {"time": None},
            {"time": np.array([])},
            {"time": np.arange(3.0)},
            {"time": np.array([np.nan, 2, 1, 3, 5])},
            {"time": np.array([np.inf, 2, 3, 4, 5])},
            {"time": np.array([1, np.nan, 3, 4, 5])},
            {"time": np.arange(5)},
            {"values": np.zeros((3, 2))},
            {"values": np.zeros((4, 1))},
            {"state_float64": np.zeros((4, 2))},
            {"state_float64": np.zeros((5, 1), ">f8")},
            {"state_float64": None},
            {"counts": np.array([1, 2])},
            {"counts": np.full(5, -1)},
            {"header": np.frombuffer(b"[]", np.uint8)},
            {"header": np.frombuffer(b"[" * 100_000, np.uint8)},
            {"header": np.frombuffer(b"\xff\xfe", np.uint8)},
            {"header": np.frombuffer(json.dumps({"format": 99}).encode(), np.uint8)},
            {"time": np.array([{}, None], object)},
        ],
        ids=lambda changed: next(f"{k}-{getattr(v, 'shape', '')}" for k, v in changed.items()),
    )
    def test_arrays_that_do_not_fit(self, saved: Path, changed: dict[str, Any]) -> None:
        refused(
            Stream(Odometer(), window=3.0), rewritten(saved, **changed), "not a saved stream, or a damaged"
        )

    def test_it_was_sound_before(self, saved: Path) -> None:
        stream = Stream(Odometer(), window=3.0)
        stream.restore(rewritten(saved))
        assert stream.time == 5.0

    def test_an_array_that_claims_more_than_is_there_takes_no_memory(self, saved: Path) -> None:
        with zipfile.ZipFile(saved) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        claim = b"(900000000000,)"
        swollen = members["time.npy"].replace(b"(5,)", claim).replace(b" " * (len(claim) - 4), b"", 1)
        assert len(swollen) == len(members["time.npy"])
        with zipfile.ZipFile(saved, "w") as archive:
            for name, content in {**members, "time.npy": swollen}.items():
                archive.writestr(name, content)
        refused(Stream(Odometer()), saved, "not a saved stream")

    def test_compressed_members_which_could_swell_are_refused(self, saved: Path) -> None:
        with np.load(saved) as archive:
            np.savez_compressed(saved, **{k: archive[k] for k in archive})
        refused(Stream(Odometer()), saved, "not a saved stream")

    def test_bytes_flipped_or_cut_off(self, saved: Path) -> None:
        """Never anything but a refusal, or the very same memory where the byte did not matter."""
        content, random = saved.read_bytes(), np.random.default_rng(0)
        states = {k: np.array(v) for k, v in self.restored(saved).state.items()}
        refusals = 0
        for _ in range(300):
            at, bit = int(random.integers(len(content))), 1 << int(random.integers(8))
            cut = random.random() < 0.2
            flipped = bytes([content[at] ^ bit])
            saved.write_bytes(content[:at] if cut else content[:at] + flipped + content[at + 1 :])
            try:
                stream = self.restored(saved)
            except InputError:
                refusals += 1
            else:
                for kind, vector in states.items():
                    np.testing.assert_array_equal(stream.state[kind], vector)
        assert refusals > 200

    @staticmethod
    def restored(path: Path) -> Stream:
        stream = Stream(Odometer(), window=3.0)
        stream.restore(path)
        return stream


def test_nothing_is_left_where_it_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot write"):
        Stream(Odometer()).save(tmp_path / "none" / "s.npz")
    assert not list(tmp_path.iterdir())
