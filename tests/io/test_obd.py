"""OBD-II replies in raw frames, against the formulas of SAE J1979 worked by hand."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core.units import convert, parse_unit
from roadstate.io.can_decode import decode_frames
from roadstate.io.can_frames import Frames
from roadstate.io.obd import PARAMETER_IDS, is_reply_id

REPLIES = [
    # payload after the length byte, name, value, unit
    ("41 04 7F", "engine_load", 100 * 0x7F / 255, "%"),
    ("41 05 5A", "coolant_temperature", 50, "degC"),
    ("41 0B 65", "intake_manifold_pressure", 101, "kPa"),
    ("41 0C 1A F8", "engine_speed", 1726, "rpm"),
    ("41 0D 35", "vehicle_speed", 53, "km/h"),
    ("41 0F 28", "intake_air_temperature", 0, "degC"),
    ("41 10 01 F4", "mass_air_flow", 5.0, "g/s"),
    ("41 11 FF", "throttle_position", 100, "%"),
    ("41 33 64", "barometric_pressure", 100, "kPa"),
    ("41 5C 82", "oil_temperature", 90, "degC"),
    ("41 61 7D", "demanded_engine_torque", 0, "%"),
    ("41 62 55", "actual_engine_torque", -40, "%"),
    ("41 63 01 5E", "reference_engine_torque", 350, "N*m"),
]


def frames(payloads: list[str], identifier: int = 0x7E8, start: float = 0.0, width: int = 8) -> Frames:
    data = np.full((len(payloads), width), 0xAA, np.uint8)  # ISO 15765 pads with anything
    for row, payload in zip(data, payloads, strict=True):
        content = bytes.fromhex(payload)
        row[: len(content) + 1] = [len(content), *content]
    n = len(payloads)
    time = start + np.arange(n, dtype=float)
    return Frames.from_columns(time, np.full(n, identifier, np.uint32), data, bus=np.full(n, 1, np.uint8))


def read(*parts: Frames) -> dict[str, tuple[list[float], list[float]]]:
    signals = decode_frames(Frames.concatenate(parts), None, "log.mf4").signals
    return {n: (s.time.tolist(), s.values.tolist()) for n, s in signals.items()}


def test_every_parameter_has_a_case_here() -> None:
    assert {f"41 {pid:02X}" for pid in PARAMETER_IDS} == {payload[:5] for payload, *_ in REPLIES}


@pytest.mark.parametrize(("payload", "name", "value", "unit"), REPLIES)
def test_a_reply_reads_as_the_standard_says(payload: str, name: str, value: float, unit: str) -> None:
    signals = decode_frames(frames([payload]), None, "log.mf4").signals
    (signal,) = signals.values()
    assert list(signals) == [f"obd.{name}"]
    assert signal.values[0] == pytest.approx(value)
    assert (signal.unit, signal.message, signal.bus) == (unit, "obd", 1)
    assert signal.source == f"log.mf4:obd.{name}"


def test_every_unit_is_one_that_can_be_converted() -> None:
    for parameter in PARAMETER_IDS.values():
        parse_unit(parameter.unit)
    assert float(convert(1.0, "g/s", "kg/s")) == pytest.approx(1e-3), "grams, not gravity"


def test_replies_keep_their_times_among_others() -> None:
    found = read(frames(["41 0C 1A F8", "41 0D 35", "41 0C 00 04", "7F 01 12", "62 F4 0C 1A"]))
    assert found == {"obd.engine_speed": ([0, 2], [1726, 1]), "obd.vehicle_speed": ([1], [53])}


def test_parts_of_longer_messages_and_short_replies_are_no_replies() -> None:
    first = frames(["41 0D 35"] * 4)
    first.data[0, 0] = 0x10  # first frame of several
    first.data[1, 0] = 0x21  # consecutive frame
    first.data[2, 0] = 0x02  # too short to hold a value
    assert read(first) == {"obd.vehicle_speed": ([3], [53])}
    cut = frames(["41 0C 1A F8", "41 0D 35"])
    cut.length[:] = 4  # the bus carried four bytes only
    assert read(cut) == {"obd.vehicle_speed": ([1], [53])}


def test_a_reply_to_several_parameters_gives_the_first() -> None:
    assert read(frames(["41 0D 35 11 80"])) == {"obd.vehicle_speed": ([0], [53])}


def test_two_ecus_that_answer_at_once_stay_apart() -> None:
    found = read(frames(["41 0D 35", "41 0C 1A F8"], 0x7E8), frames(["41 0D 36"], 0x7E9))
    assert found == {
        "obd.vehicle_speed@0x7E8": ([0], [53]),
        "obd.vehicle_speed@0x7E9": ([0], [54]),
        "obd.engine_speed": ([1], [1726]),
    }


def test_replies_on_29_bits() -> None:
    assert read(frames(["41 0D 35"], 0x18DAF110)) == {"obd.vehicle_speed": ([0], [53])}


def test_only_the_ids_of_replies_are_read() -> None:
    assert is_reply_id(0x7E8, False)
    assert is_reply_id(0x7EF, False)
    assert is_reply_id(0x18DAF1FF, True)
    assert not is_reply_id(0x7E0, False)
    assert not is_reply_id(0x7F0, False)
    assert not is_reply_id(0x7E8, True)
    assert not is_reply_id(0x18DA10F1, True)


def test_narrow_frames_are_no_replies() -> None:
    found = read(frames(["41 0D 35"]), frames(["41"], 0x7E9, width=2))
    assert found == {"obd.vehicle_speed": ([0], [53])}
