"""The vectorised decoder against cantools' own, frame by frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cantools.database
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadstate.core import InputError
from roadstate.io.can_decode import decode_frames, decode_message
from roadstate.io.can_frames import Frames, identifier_text
from roadstate.io.dbc import load_dbc, parameter_group

HEAD = 'VERSION ""\n\nBS_:\n\nBU_: ECU\n\n'


def frames_of(
    data: np.ndarray, identifier: int = 0x100, *, extended: bool = False, length: Any = None, bus: int = 0
) -> Frames:
    n = len(data)
    return Frames.from_columns(
        np.arange(n) * 0.01,
        np.full(n, identifier, np.uint32),
        np.asarray(data, np.uint8),
        length=None if length is None else np.asarray(length, np.uint8),
        bus=np.full(n, bus, np.uint8),
        is_extended=np.full(n, extended),
    )


def joined(*parts: Frames) -> Frames:
    return Frames.concatenate(parts)


def dbc_file(tmp_path: Path, text: str, name: str = "bus.dbc") -> Path:
    path = tmp_path / name
    path.write_text(HEAD + text)
    return path


def signals_of(frames: Frames, path: Path) -> dict[str, np.ndarray]:
    return {n: s.values for n, s in decode_frames(frames, load_dbc([path]), "log.mf4").signals.items()}


@st.composite
def layouts(draw: st.DrawFn) -> tuple[str, bool, int]:
    """A signal's DBC line, whether it is a float, and its bits; anywhere in a frame of 8 bytes."""
    is_big = draw(st.booleans())
    is_float = draw(st.integers(0, 5)) == 0
    bits = draw(st.sampled_from([32, 64])) if is_float else draw(st.integers(1, 64))
    first = draw(st.integers(0, 64 - bits))
    # a DBC counts the bits of a byte from the right, the wire (and so a big-endian signal) from the left
    start = 8 * (first // 8) + 7 - first % 8 if is_big else first
    sign = draw(st.sampled_from("+-"))
    scale = draw(st.sampled_from([1, 2, 0.1, 0.03589, -0.25, 1e-6]))
    offset = draw(st.sampled_from([0, -40, 0.5, -18.375]))
    return f"{start}|{bits}@{0 if is_big else 1}{sign} ({scale},{offset})", is_float, bits


@settings(max_examples=150, deadline=None)
@given(
    lines=st.lists(layouts(), min_size=1, max_size=6),
    seed=st.integers(0, 2**32 - 1),
    is_truncated=st.booleans(),
)
def test_every_layout_decodes_as_cantools_decodes_it(
    tmp_path_factory: pytest.TempPathFactory,
    lines: list[tuple[str, bool, int]],
    seed: int,
    is_truncated: bool,
) -> None:
    text, types = "", ""
    for i, (line, is_float, bits) in enumerate(lines):
        text += f'BO_ {i + 1} m{i}: 8 ECU\n SG_ s : {line} [0|0] "x" ECU\n\n'
        if is_float:
            types += f"SIG_VALTYPE_ {i + 1} s : {1 if bits == 32 else 2};\n"
    path = dbc_file(tmp_path_factory.mktemp("dbc"), text + types)
    oracle = cantools.database.load_file(path)
    rng = np.random.default_rng(seed)
    data = rng.choice([0, 1, 0x7F, 0x80, 0xFE, 0xFF, rng.integers(256)], (12, 8)).astype(np.uint8)
    data[6:] = rng.integers(0, 256, (6, 8))
    length = rng.integers(0, 9, 12) if is_truncated else np.full(12, 8)
    for i in range(len(lines)):
        ours = signals_of(frames_of(data, i + 1, length=length), path)[f"m{i}.s"]
        for row, size, value in zip(data, length, ours, strict=True):
            decoded = oracle.decode_message(
                i + 1, row[:size].tobytes(), decode_choices=False, allow_truncated=True
            )
            expected = float(decoded.get("s", np.nan))  # type: ignore[union-attr,arg-type]
            np.testing.assert_allclose(
                value, expected, rtol=4e-16, atol=0, err_msg=f"{lines[i]} {bytes(row)!r}"
            )


def test_signals_of_one_message_decode_as_cantools_decodes_them(tmp_path: Path) -> None:
    path = dbc_file(
        tmp_path,
        "BO_ 257 imu: 8 ECU\n"
        ' SG_ valid : 0|1@1+ (1,0) [0|0] "" ECU\n'
        ' SG_ x : 1|10@1+ (0.125,-64) [0|0] "m/s^2" ECU\n'
        ' SG_ y : 11|11@1- (0.25,0) [0|0] "deg/s" ECU\n'
        ' SG_ torque : 31|16@0- (0.5,0) [0|0] "N*m" ECU\n'
        ' SG_ angle : 47|12@0+ (0.1,-90) [0|0] "deg" ECU\n'
        ' SG_ temperature : 56|8@1- (1,-40) [0|0] "degC" ECU\n',
    )
    oracle = cantools.database.load_file(path)
    data = np.random.default_rng(3).integers(0, 256, (200, 8), dtype=np.uint8)
    recording = decode_frames(frames_of(data, 257, bus=2), load_dbc([path]), "a/log.mf4").signals
    for i, row in enumerate(data):
        for name, value in oracle.decode_message(257, row.tobytes()).items():  # type: ignore[union-attr]
            np.testing.assert_allclose(recording[f"imu.{name}"].values[i], value, rtol=1e-15)
    x = recording["imu.x"]
    assert (x.unit, x.message, x.bus, x.source) == ("m/s^2", "imu", 2, "log.mf4:imu.x")
    assert recording["imu.valid"].unit is None
    assert all(s.time is x.time for s in recording.values()), "one message, one time base"


MULTIPLEXED = (
    "BO_ 10 page: 8 ECU\n"
    ' SG_ mode M : 0|4@1+ (1,0) [0|0] "" ECU\n'
    ' SG_ always : 4|4@1+ (1,0) [0|0] "" ECU\n'
    ' SG_ speed m0 : 8|16@1+ (0.01,0) [0|0] "km/h" ECU\n'
    ' SG_ torque m1 : 8|16@1- (0.5,0) [0|0] "N*m" ECU\n'
    ' SG_ inner m2M : 8|8@1+ (1,0) [0|0] "" ECU\n'
    ' SG_ deep m3 : 16|8@1+ (1,-40) [0|0] "degC" ECU\n'
    ' SG_ shared m0 : 32|8@1+ (1,0) [0|0] "" ECU\n\n'
    "SG_MUL_VAL_ 10 inner mode 2-2;\n"
    "SG_MUL_VAL_ 10 deep inner 3-3, 5-6;\n"
    "SG_MUL_VAL_ 10 speed mode 0-0;\n"
    "SG_MUL_VAL_ 10 torque mode 1-1;\n"
    "SG_MUL_VAL_ 10 shared mode 0-1;\n"
)


def test_multiplexed_signals_have_samples_only_where_they_are_sent(tmp_path: Path) -> None:
    path = dbc_file(tmp_path, MULTIPLEXED)
    oracle = cantools.database.load_file(path)
    rng = np.random.default_rng(5)
    data = rng.integers(0, 256, (300, 8), dtype=np.uint8)
    data[:, 0] = rng.integers(0, 4, 300) | (data[:, 0] & 0xF0)
    data[:, 1] = np.where(data[:, 0] & 0xF == 2, rng.integers(0, 8, 300), data[:, 1])
    ours = decode_frames(frames_of(data, 10), load_dbc([path]), "log").signals
    expected: dict[str, list[tuple[float, float]]] = {}
    for i, row in enumerate(data):
        mode, inner = row[0] & 0xF, row[1]
        if mode == 3 or (mode == 2 and inner not in (3, 5, 6)):
            continue  # cantools refuses such a frame; what it still holds is checked below
        for name, value in oracle.decode_message(10, row.tobytes()).items():  # type: ignore[union-attr]
            expected.setdefault(name, []).append((i * 0.01, float(value)))  # type: ignore[arg-type]
    for name in ("speed", "torque", "deep", "shared"):
        signal = ours[f"page.{name}"]
        np.testing.assert_allclose(np.stack([signal.time, signal.values], 1), expected[name], rtol=1e-15)
    assert len(ours["page.always"]) == 300
    assert len(ours["page.inner"]) == np.sum(data[:, 0] & 0xF == 2)
    assert ours["page.shared"].time is not ours["page.speed"].time


def test_an_unused_multiplexed_signal_is_absent(tmp_path: Path) -> None:
    path = dbc_file(tmp_path, MULTIPLEXED)
    only_speed = np.zeros((4, 8), np.uint8)
    names = set(decode_frames(frames_of(only_speed, 10), load_dbc([path]), "log").signals)
    assert names == {"page.mode", "page.always", "page.speed", "page.shared"}


def test_a_nan_of_a_float_signal_stays_nan_and_values_out_of_range_stay_as_they_are(tmp_path: Path) -> None:
    path = dbc_file(
        tmp_path,
        'BO_ 1 m: 8 ECU\n SG_ f : 0|32@1- (1,0) [-1|1] "" ECU\n SG_ u : 32|8@1+ (1,0) [0|10] "" ECU\n\n'
        "SIG_VALTYPE_ 1 f : 1;\n",
    )
    data = np.zeros((2, 8), np.uint8)
    data[:, :4] = np.array([np.nan, 250.0], "<f4").view(np.uint8).reshape(2, 4)
    data[:, 4] = [0xFF, 0xFE]
    values = signals_of(frames_of(data, 1), path)
    np.testing.assert_array_equal(values["m.f"], [np.nan, 250.0])
    np.testing.assert_array_equal(values["m.u"], [255.0, 254.0])


def test_one_message_on_two_buses_is_named_by_bus(tmp_path: Path) -> None:
    path = dbc_file(tmp_path, 'BO_ 256 m: 1 ECU\n SG_ s : 0|8@1+ (1,0) [0|0] "" ECU\n')
    both = joined(frames_of(np.full((3, 1), 7), bus=1), frames_of(np.full((2, 1), 9), bus=2))
    signals = decode_frames(both, load_dbc([path]), "log.mf4").signals
    assert set(signals) == {"m.s@1", "m.s@2"}
    assert (signals["m.s@1"].bus, signals["m.s@2"].bus) == (1, 2)
    np.testing.assert_array_equal(signals["m.s@2"].values, [9, 9])
    assert signals["m.s@2"].source == "log.mf4:m.s@2"


J1939 = (
    'BO_ 2364540158 EEC1: 8 ECU\n SG_ EngineSpeed : 24|16@1+ (0.125,0) [0|8031.875] "rpm" ECU\n'
    ' SG_ Mode : 0|4@1+ (1,0) [0|15] "" ECU\n\n'
    'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";\n'
    'BA_DEF_DEF_ "VFrameFormat" "{default}";\n'
)


@pytest.mark.parametrize("default", ["J1939PG", "ExtendedCAN"])
def test_j1939_matches_any_sender_and_priority_by_parameter_group(tmp_path: Path, default: str) -> None:
    path = dbc_file(tmp_path, J1939.format(default=default))
    data = np.zeros((2, 8), np.uint8)
    data[:, 3:5] = [[0x40, 0x1F], [0x80, 0x3E]]
    # 0x0CF00400 and, at another priority, 0x18F00400 from the same sender
    both = joined(
        frames_of(data[:1], 0x0CF00400, extended=True), frames_of(data[1:], 0x18F00400, extended=True)
    )
    np.testing.assert_array_equal(signals_of(both, path)["EEC1.EngineSpeed"], [1000, 2000])
    two_senders = joined(
        frames_of(data, 0x0CF00400, extended=True), frames_of(data, 0x0CF00427, extended=True)
    )
    assert {n for n in signals_of(two_senders, path) if "Speed" in n} == {
        "EEC1.EngineSpeed@0x00",
        "EEC1.EngineSpeed@0x27",
    }


def test_j1939_not_available_and_error_are_missing(tmp_path: Path) -> None:
    path = dbc_file(tmp_path, J1939.format(default="J1939PG"))
    data = np.zeros((4, 8), np.uint8)
    data[:, 3:5] = [[0xFF, 0xFF], [0x00, 0xFE], [0xFF, 0xFA], [0x08, 0x00]]
    data[:, 0] = [0x0F, 0x0E, 0xF1, 0x00]
    values = signals_of(frames_of(data, 0x0CF00400, extended=True), path)
    np.testing.assert_array_equal(values["EEC1.EngineSpeed"], [np.nan, np.nan, 8031.875, 1.0])
    np.testing.assert_array_equal(values["EEC1.Mode"], [np.nan, 14, 1, 0])


def test_parameter_group_leaves_the_destination_out() -> None:
    assert parameter_group(0x0CF00400) == 0xF004
    assert parameter_group(0x18EF27FE) == parameter_group(0x18EF00FE) == 0xEF00
    assert parameter_group(0x19F805FE) == 0x1F805


def test_a_29_bit_id_that_is_not_j1939_needs_its_exact_id(tmp_path: Path) -> None:
    path = dbc_file(tmp_path, f'BO_ {0x17F00010 | 1 << 31} m: 8 ECU\n SG_ s : 0|8@1+ (1,0) [0|0] "" ECU\n')
    assert list(signals_of(frames_of(np.ones((1, 8)), 0x17F00010, extended=True), path)) == ["m.s"]
    with pytest.raises(InputError, match=r"no id of the log is in bus\.dbc"):
        signals_of(frames_of(np.ones((1, 8)), 0x17F00011, extended=True), path)


def test_ids_of_11_and_29_bits_are_told_apart(tmp_path: Path) -> None:
    path = dbc_file(tmp_path, f'BO_ {0x100 | 1 << 31} long: 8 ECU\n SG_ s : 0|8@1+ (1,0) [0|0] "" ECU\n')
    assert list(signals_of(frames_of(np.ones((1, 8)), 0x100, extended=True), path)) == ["long.s"]
    with pytest.raises(InputError, match="the log has 0x100; the DBC has 0x00000100"):
        signals_of(frames_of(np.ones((1, 8)), 0x100), path)


def test_an_id_beyond_11_bits_is_extended_whatever_its_flag_says() -> None:
    frames = frames_of(np.ones((1, 8)), 0x17F00010)
    assert frames.is_extended[0]
    flagged = Frames.from_columns(np.zeros(1), np.array([0x80000005], np.uint32), np.ones((1, 8), np.uint8))
    assert flagged.is_extended[0]
    assert identifier_text(int(flagged.identifier[0]), True) == "0x00000005"


def test_messages_of_several_frames_are_named_and_left_out(tmp_path: Path) -> None:
    path = dbc_file(
        tmp_path,
        'BO_ 2028 Battery: 62 ECU\n SG_ charge : 64|8@1+ (0.5,0) [0|0] "%" ECU\n\n'
        'BO_ 5 plain: 8 ECU\n SG_ s : 0|8@1+ (1,0) [0|0] "" ECU\n',
    )
    battery, plain = frames_of(np.ones((2, 8)), 2028), frames_of(np.ones((2, 8)), 5)
    with pytest.raises(
        InputError, match=r"nothing could be decoded: Battery: 62 bytes sent in several frames"
    ):
        decode_frames(battery, load_dbc([path]), "log.mf4")
    decoding = decode_frames(joined(battery, plain), load_dbc([path]), "log.mf4")
    assert list(decoding.signals) == ["plain.s"]
    assert decoding.skipped == ("Battery: 62 bytes sent in several frames (transport protocol)",)


def test_can_fd_messages_decode_in_one_frame(tmp_path: Path) -> None:
    path = dbc_file(tmp_path, 'BO_ 5 fd: 64 ECU\n SG_ s : 504|8@1+ (1,0) [0|0] "" ECU\n')
    data = np.zeros((2, 64), np.uint8)
    data[:, 63] = [3, 4]
    np.testing.assert_array_equal(signals_of(frames_of(data, 5), path)["fd.s"], [3, 4])


def test_what_no_dbc_explains_is_listed(tmp_path: Path) -> None:
    path = dbc_file(tmp_path, 'BO_ 5 m: 8 ECU\n SG_ s : 0|8@1+ (1,0) [0|0] "" ECU\n')
    both = joined(frames_of(np.ones((1, 8)), 5), frames_of(np.ones((1, 8)), 0x6AB))
    assert decode_frames(both, load_dbc([path]), "log").undecoded == ("0x6AB",)


def test_a_dbc_of_another_car_is_refused_with_both_lists(tmp_path: Path) -> None:
    path = dbc_file(tmp_path, 'BO_ 5 m: 8 ECU\n SG_ s : 0|8@1+ (1,0) [0|0] "" ECU\n')
    with pytest.raises(InputError) as refusal:
        decode_frames(frames_of(np.ones((1, 8)), 0x123), load_dbc([path]), "drive.mf4")
    assert str(refusal.value) == (
        "drive.mf4: no id of the log is in bus.dbc: the log has 0x123; the DBC has 0x005; "
        "give the DBC of this car's bus"
    )


def test_frames_without_a_dbc_ask_for_one_and_none_at_all_say_so() -> None:
    with pytest.raises(InputError, match=r"raw CAN frames without a DBC \(ids 0x100\); name one with --dbc"):
        decode_frames(frames_of(np.ones((1, 8))), None, "drive.mf4")
    with pytest.raises(InputError, match="holds no CAN frames"):
        decode_frames(frames_of(np.ones((0, 8))), None, "drive.mf4")


def test_signals_of_more_than_64_bits_are_left_out(tmp_path: Path) -> None:
    path = dbc_file(
        tmp_path,
        'BO_ 5 m: 16 ECU\n SG_ text : 0|96@1+ (1,0) [0|0] "" ECU\n SG_ s : 96|8@1+ (1,0) [0|0] "" ECU\n',
    )
    decoding = decode_frames(frames_of(np.ones((1, 16)), 5), load_dbc([path]), "log")
    assert (list(decoding.signals), decoding.skipped) == (["m.s"], ("m.text: more than 64 bits",))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("BO_ 1 M: x\n", "not a readable DBC file: invalid syntax at line 7, column 10; is it complete?"),
        ('BO_ 1 M: 8 X\n SG_ a : 0|8@1+ (1,0) [0|0 "" X\n', "invalid syntax at line 8, column"),
        ('BO_ 1 M: 8 X\n SG_ a : 0|0@1+ (1,0) [0|0] "" X\n', "length 0 is not greater than 0"),
        ("", "the DBC defines no message"),
        ("\x00\x01\x02binary", "not a readable DBC file: invalid syntax at line 7"),
    ],
)
def test_a_broken_dbc_names_the_line(tmp_path: Path, text: str, message: str) -> None:
    path = dbc_file(tmp_path, text)
    with pytest.raises(InputError) as refusal:
        load_dbc([path])
    assert str(refusal.value).startswith(str(path))
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_missing_dbc_and_messages_defined_twice_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no\.dbc: no such file"):
        load_dbc([tmp_path / "no.dbc"])
    one = dbc_file(tmp_path, 'BO_ 5 m: 8 ECU\n SG_ s : 0|8@1+ (1,0) [0|0] "" ECU\n', "one.dbc")
    other = dbc_file(tmp_path, 'BO_ 5 n: 8 ECU\n SG_ s : 0|8@1+ (1,0) [0|0] "" ECU\n', "other.dbc")
    renumbered = dbc_file(tmp_path, 'BO_ 6 m: 8 ECU\n SG_ s : 0|8@1+ (1,0) [0|0] "" ECU\n', "six.dbc")
    with pytest.raises(InputError, match=r"other\.dbc: message n has id 0x005, as m of .*one\.dbc"):
        load_dbc([one, other])
    with pytest.raises(InputError, match=r"six\.dbc: a message m is also in .*one\.dbc"):
        load_dbc([one, renumbered])


def test_decode_message_takes_a_time_base_from_its_frames(tmp_path: Path) -> None:
    path = dbc_file(tmp_path, 'BO_ 256 m: 2 ECU\n SG_ s : 0|8@1+ (1,0) [0|0] "" ECU\n')
    frames = frames_of(np.arange(10).reshape(5, 2))
    message, _ = load_dbc([path]).find(0x100, False) or pytest.fail("not found")
    (decoded,) = decode_message(frames, message)
    assert decoded.signal.time is frames.time
    np.testing.assert_array_equal(decoded.signal.values, [0, 2, 4, 6, 8])
