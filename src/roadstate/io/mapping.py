"""From a file's own signals to canonical channels: which signal is which, in which unit, sign and time."""

from __future__ import annotations

from collections.abc import Mapping as AbstractMapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from roadstate.core import CHANNELS, InputError, Recording, Signal
from roadstate.core.held import sampled
from roadstate.core.signals import in_order, interpolate
from roadstate.core.units import to_channel_unit
from roadstate.io.lever_arm import to_center
from roadstate.io.mapping_channel import ChannelMap, Condition, Gain, is_linear_wheel_speed, is_slope
from roadstate.io.mapping_schema import IMU_CHANNELS, Axes, Sections, SlopeMap
from roadstate.io.mapping_yaml import in_one_line, read_mapping_file
from roadstate.io.matching import Candidate, find, not_found
from roadstate.io.plausible import check_plausible
from roadstate.io.reference import slope_reference
from roadstate.io.speed_unit import check_speed_unit

Array = NDArray[np.float64]

_TOLERANCE = 1e-6  # relative, when raw values are compared with those that mean invalid
_MOST_OUT_OF_ORDER = 0.05  # of a signal's samples, that may be left out
_FEW = 10  # that may in any case
_OF_A_MAPPING = ("mapped", "sources", "reference_std", "dropped", "held", "misspelt")


class Mapping(Sections):
    """A mapping file's content: :meth:`apply` turns a recording's raw signals into canonical channels."""

    @property
    def time_column(self) -> str | None:
        """The time column of a tabular file; ``None`` where the file is left to tell."""
        return self.time.column

    @property
    def time_unit(self) -> str | None:
        """The time column's unit, where its header gives none."""
        return self.time.unit

    def apply(self, recording: Recording, *, wheel_radius: float | None = None) -> Recording:
        """The canonical channels of a recording, in SI units, each on its own time base.

        Raw signals that carry a canonical name and are not listed are taken too, unless ``only_listed``.

        Args:
            recording: as read.
            wheel_radius: effective rolling radius in m, for wheel speeds given along the road, and to hold
                the speed's unit against the wheels'.

        Returns:
            Canonical signals. The metadata are kept, with ``mapped`` (canonical → what it was made of, in
            words), ``sources`` (canonical → raw names) and, where there are any, ``dropped`` (raw name →
            samples left out for their time), ``held`` (canonical → rows for which each sample is repeated,
            which were left out: :func:`~roadstate.core.held.sampled`), ``misspelt`` (raw name → the canonical
            one that it is but for case, blanks and hyphens, where nothing else became that channel) and
            ``reference_std`` (of derived references: their standard error, the median over the log, in SI;
            that of a reference taken as it is stays).

        Raises:
            InputError: a channel's signal is not there or there twice, a unit does not fit, a time base does
                not increase or could be repaired only by leaving out over 5 % of it, the values are
                implausible for more than 1 % of the samples, or the speed is the wheels' in another unit.
        """
        return _Application(self, recording, wheel_radius).run()


DEFAULT_MAPPING = Mapping()
"""Takes every signal that carries a canonical name, in the unit its file gives; ignores all others."""


def load_mapping(path: str | Path) -> Mapping:
    """Read a mapping file.

    Args:
        path: YAML; the documentation has the table of its keys.

    Raises:
        InputError: not readable, no YAML, or a key or value that is wrong; names line and key.
    """
    content = read_mapping_file(path)
    try:
        return Mapping.model_validate(content.data)
    except ValidationError as error:
        raise in_one_line(error, content, str(path)) from None


class _Application:
    """One mapping applied to one recording; caches keep time bases shared between signals."""

    def __init__(self, mapping: Mapping, recording: Recording, wheel_radius: float | None) -> None:
        self.mapping = mapping
        self.recording = recording
        self.wheel_radius = wheel_radius
        self.checked: dict[str, Signal] = {}
        self.bases: dict[tuple[int, float], tuple[Array, Array]] = {}
        self.keeps: dict[int, tuple[Array, NDArray[np.bool_]]] = {}
        self.out: dict[str, Signal] = {}
        self.mapped: dict[str, str] = {}
        self.sources: dict[str, list[str]] = {}
        self.reference_std: dict[str, float] = {}
        self.dropped: dict[str, int] = {}
        self.held: dict[str, int] = {}
        self.units: dict[str, str] = {}

    def run(self) -> Recording:
        mapping = self.mapping
        for name, spec in mapping.channels.items():
            self.take(name, spec)
        for kind, names in IMU_CHANNELS.items():
            if mapping.imu is not None and (axes := getattr(mapping.imu, kind)) is not None:
                self.take_imu(f"imu.{kind}", axes, names)
        for name, reference in mapping.reference.items():
            if isinstance(reference, SlopeMap):
                self.take_slope(name, reference)
            else:
                self.take(name, reference)
        if not mapping.only_listed:
            given = {*mapping.channels, *mapping.reference, *self.out, "time"}
            for name in self.recording:
                if name in CHANNELS and name not in given:
                    self.take(name, ChannelMap.model_validate(name))
        if mapping.lever_arm is not None:
            self.out |= to_center(self.out, mapping.lever_arm)
        if self.wheel_radius is not None:
            check_speed_unit(self.out, self.units, self.wheel_radius)
        metadata = {k: v for k, v in self.recording.metadata.items() if k not in _OF_A_MAPPING}
        metadata |= {"mapped": self.mapped, "sources": self.sources}
        metadata |= {"reference_std": self.reference_std} if self.reference_std else {}
        metadata |= {"dropped": self.dropped} if self.dropped else {}
        metadata |= {"held": self.held} if self.held else {}
        misspelt = {} if mapping.only_listed else self.misspelt()
        metadata |= {"misspelt": misspelt} if misspelt else {}
        return Recording(self.out, metadata)

    def misspelt(self) -> dict[str, str]:
        """Raw names that are those of channels not there, but for their spelling."""
        used = {key for keys in self.sources.values() for key in keys}
        plain = {key: "_".join(key.lower().replace("-", " ").split()) for key in self.recording}
        return {
            key: name
            for key, name in plain.items()
            if name in CHANNELS and name != "time" and name not in self.out and key not in used
        }

    def take(self, name: str, spec: ChannelMap) -> None:
        key = self.find(name, spec)
        if key is None:
            return
        signal = self.convert(name, key, spec)
        unit = CHANNELS[name].unit if spec.scale.unit else self.unit_of(name, key, spec)
        check_plausible(name, signal, unit)
        self.units[name] = unit
        self.put(name, signal, key, [key])
        told = self.recording.metadata.get("reference_std")
        is_as_read = key == name and spec.unit is None and spec.scale == Gain()
        if is_as_read and isinstance(told, dict) and name in told:
            self.reference_std[name] = told[name]

    def put(self, name: str, signal: Signal, made_of: str, keys: list[str]) -> None:
        if self.mapping.time.held == "drop" and not CHANNELS[name].is_reference:
            values, rows = sampled(signal.values)
            if rows > 1:
                self.held[name], signal = rows, replace(signal, values=values)
        self.out[name], self.mapped[name], self.sources[name] = signal, made_of, keys

    def take_imu(self, place: str, axes: Axes, names: tuple[str, ...]) -> None:
        measured: dict[int, Signal] = {}
        keys: dict[int, str] = {}
        for i, axis in enumerate("xyz"):
            spec = getattr(axes, axis)
            key = self.find(f"{place}.{axis}", spec) if spec is not None else None
            if key is not None:
                measured[i] = self.convert(names[0], key, spec)
                keys[i] = key
        rotation = self.mapping.rotation.to_matrix() if self.mapping.rotation is not None else np.eye(3)
        made = False
        for name, row in zip(names, rotation, strict=True):
            needed = [i for i in np.argsort(-np.abs(row)) if abs(row[i]) > _TOLERANCE]
            if not all(i in measured for i in needed):
                continue
            signal = _combined([(float(row[i]), measured[i]) for i in needed])
            check_plausible(name, signal, CHANNELS[name].unit)
            self.put(name, signal, ", ".join(keys[i] for i in needed), [keys[i] for i in needed])
            made = True
        if measured and not made:
            raise InputError(
                f"of its axes only {', '.join('xyz'[i] for i in measured)} are there: "
                "none of the car's can be made from them",
                where=place,
                mend="give all three",
            )

    def take_slope(self, name: str, spec: SlopeMap) -> None:
        altitude_key = self.find(f"{name}.slope_of", spec.slope_of)
        speed_key = self.find(f"{name}.speed", spec.speed)
        if altitude_key is None or speed_key is None:
            return
        altitude = self.convert("altitude", altitude_key, spec.slope_of)
        speed = self.convert("speed", speed_key, spec.speed)
        slope = slope_reference(altitude, speed, over=spec.over, min_speed=spec.min_speed)
        check_plausible(name, slope.grade, "rad")
        self.put(name, slope.grade, f"slope of {altitude_key} over {speed_key}", [altitude_key, speed_key])
        if np.isfinite(slope.median_std):
            self.reference_std[name] = slope.median_std

    def find(self, place: str, spec: ChannelMap) -> str | None:
        try:
            key = find(spec.from_, self.recording.signals)
            if key is None and not spec.optional:
                skipped = self.recording.metadata.get("skipped", ())
                raise not_found(spec.from_, self.recording.signals, skipped)
        except InputError as error:
            raise InputError(error.what, where=self.where(place), mend=error.mend) from error
        return key

    def where(self, place: str) -> str:
        files = self.recording.metadata.get("files") or ()
        return f"{Path(str(files[0])).name}: {place}" if files else place

    def raw(self, key: str) -> Signal:
        """The signal as read, its time base checked or repaired."""
        if key not in self.checked:
            signal = self.recording[key]
            if self.mapping.time.repair == "drop":
                keep = self.kept(key, signal)
                time = self.shared(signal.time, -0.0, signal.time[keep])
                signal = replace(signal, time=time, values=signal.values[keep])
            else:
                signal.check_time()
            self.checked[key] = signal
        return self.checked[key]

    def kept(self, key: str, signal: Signal) -> NDArray[np.bool_]:
        """Which samples stay when the time base is repaired; refuses to leave out a good part of it."""
        if id(signal.time) not in self.keeps:  # as below, the base is kept beside what was made of it
            self.keeps[id(signal.time)] = (signal.time, in_order(signal.time))
        time, keep = self.keeps[id(signal.time)]
        if keep.all():
            return keep
        self.dropped[key] = int((~keep).sum())
        is_repeat = np.zeros(len(time), bool)
        is_repeat[1:] = time[1:] == time[:-1]
        count = int((~keep & np.isfinite(time) & ~is_repeat).sum())
        if count > max(_MOST_OUT_OF_ORDER * len(time), _FEW):
            raise InputError(
                f"the time of {count} of {len(time)} samples is out of order: too many to leave out",
                where=signal.source or key,
                mend="sort the log, or cut it where its clock was set and run the parts with --separate",
            )
        return keep

    def shared(self, base: Array, delay: float, time: Array) -> Array:
        """``time``, or the equal array made before from the same ``base``, so that the two stay one base."""
        # the base is kept beside it: an id is only unique while its object lives
        return self.bases.setdefault((id(base), delay), (base, time))[1]

    def unit_of(self, name: str, key: str, spec: ChannelMap) -> str:
        given = spec.unit if spec.unit is not None else self.recording[key].unit
        fallback = "-" if spec.scale.unit else CHANNELS[name].unit
        return given if given is not None and given.strip(" []") else fallback

    def convert(self, name: str, key: str, spec: ChannelMap) -> Signal:
        """The signal in the SI unit of the channel ``name``, invalid samples NaN, the delay taken off."""
        raw = self.raw(key)
        source = raw.source or key
        values = np.where(self.is_valid(name, raw, spec), raw.values, np.nan)
        unit = self.unit_of(name, key, spec)
        try:
            if spec.scale.unit:
                values = to_channel_unit(values, unit, "-")
                values = to_channel_unit(values, spec.scale.unit, CHANNELS[name].unit)
            elif is_linear_wheel_speed(name, unit):
                values = to_channel_unit(values, unit, "m/s") / self.radius(name, unit)
            else:
                values = to_channel_unit(values, unit, CHANNELS[name].unit, is_slope=is_slope(name))
        except InputError as error:
            raise InputError(error.what, where=f"{source} as {name}", mend=error.mend) from error
        gain, offset = spec.sign * spec.scale.value, spec.offset_in(name)
        if gain != 1.0 or offset != 0.0:
            values = gain * values + offset
        time = raw.time
        if spec.delay != 0.0:
            time = self.shared(raw.time, spec.delay, raw.time - spec.delay)
        return replace(raw, time=time, values=values, unit=CHANNELS[name].unit, source=source)

    def radius(self, name: str, unit: str) -> float:
        if self.wheel_radius is None:
            raise InputError(
                f"is in {unit} along the road and the wheel's radius is not known",
                mend="give a vehicle file (--vehicle), or set 'unit: rad/s' and a scale of 1/radius",
            )
        if not 0.05 <= self.wheel_radius <= 2.0:
            raise InputError(f"a wheel radius of {self.wheel_radius:g} m is out of range", mend="0.05 to 2 m")
        return self.wheel_radius

    def is_valid(self, name: str, raw: Signal, spec: ChannelMap) -> NDArray[np.bool_]:
        valid = np.isfinite(raw.values)
        for value in spec.invalid:
            valid &= ~np.isclose(raw.values, value, rtol=_TOLERANCE, atol=1e-9)
        if spec.range is not None:
            valid &= (raw.values >= spec.range[0]) & (raw.values <= spec.range[1])
        for condition in spec.valid:
            valid &= self.holds(name, condition, raw)
        return valid

    def holds(self, name: str, condition: Condition, raw: Signal) -> NDArray[np.bool_]:
        """Whether a condition holds at each sample; it does not where its signal has not been heard yet."""
        companion = self.raw(self.companion(name, condition, raw))
        with np.errstate(invalid="ignore"):
            holds = np.isfinite(companion.values)
            if condition.equals is not None:
                holds &= np.isclose(companion.values, condition.equals, rtol=_TOLERANCE, atol=1e-9)
            if condition.min is not None:
                holds &= companion.values >= condition.min
            if condition.max is not None:
                holds &= companion.values <= condition.max
        if companion.time is raw.time or np.array_equal(companion.time, raw.time):
            return holds
        if not len(companion):
            return np.zeros(len(raw), dtype=bool)
        latest = np.searchsorted(companion.time, raw.time, side="right") - 1
        return holds[np.maximum(latest, 0)] & (latest >= 0)

    def companion(self, name: str, condition: Condition, raw: Signal) -> str:
        signals: AbstractMapping[str, Signal] = self.recording.signals
        candidate: Candidate = condition.candidate
        beside = {k: s for k, s in signals.items() if s.message == raw.message and s.bus == raw.bus}
        try:
            # its own message's flag is meant, however many messages have one of that name
            key = (find([candidate], beside) if raw.message else None) or find([candidate], signals)
            if key is None:
                raise not_found([candidate], signals)
        except InputError as error:
            raise InputError(error.what, where=self.where(f"{name}.valid"), mend=error.mend) from error
        return key


def _combined(parts: list[tuple[float, Signal]]) -> Signal:
    """Σ cᵢ·sᵢ on the time base of the first, the others interpolated where theirs differs."""
    total = parts[0][0] * parts[0][1].values
    base = parts[0][1]
    for factor, signal in parts[1:]:
        is_same = signal.time is base.time or np.array_equal(signal.time, base.time)
        total = total + factor * (signal.values if is_same else interpolate(signal, base.time))
    return replace(base, values=total)
