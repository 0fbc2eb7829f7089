"""A draft of a mapping file, from the names, units and magnitudes of a recording's signals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from roadstate.core import InputError, Recording
from roadstate.io.mapping_schema import IMU_CHANNELS
from roadstate.io.suggest_choices import Choice, as_yaml, choices_for, sensor_of, settle, truths_for
from roadstate.io.suggest_words import REFERENCE_RULES, RULES

_MARGIN = 1.0  # of the score, below which two signals fit equally well
_GRAVITY = (7.0, 12.0)  # m/s^2
_MAX_UNUSED = 60
_SENSOR_AXES = frozenset(name for names in IMU_CHANNELS.values() for name in names)
_HEAD = """\
# Draft of a mapping, made from names, units and magnitudes. Check each line before you rely on it:
# - signs: left turns, forward acceleration and driving torque are positive, z points up;
# - accel_* include gravity (an IMU); an acceleration without it belongs to kinematic_accel_*;
# - an IMU whose axes are not the car's goes under 'imu:' with a 'rotation:'.
"""


def suggest(recording: Recording) -> str:
    """Draft a mapping file for a recording.

    Signals whose name says which channel they are, and whose unit and magnitude agree, are listed. Where
    several fit equally well, or something speaks against one, it stands there as a comment. The draft always
    loads, and applies to the recording it was made from (wheel speeds along the road need a wheel radius).

    Args:
        recording: as read.

    Returns:
        YAML text.
    """
    drop = _needs_repair(recording)
    drafts = {rule.channel: choices_for(rule, recording) for rule in RULES}
    settled = {name: [settle(c, recording, drop) for c in choices] for name, choices in drafts.items()}
    tilted = _tilted_sensors(settled, recording)
    lines = ["channels:"]
    for name, choices in settled.items():
        lines += [f"  {line}" for line in _entries(name, _without(choices, tilted, recording))]
    for sensor, up in tilted.items():
        lines += ["", *_imu_block(sensor, up, settled, recording)]
    truth = [c for rule in REFERENCE_RULES for c in truths_for(rule, recording)]
    if truth:
        lines += ["", "# Truth to compare with, if that is what it is:", "# reference:"]
        lines += [f"#   {c.line()}" for c in truth]
    used = {c.key for c in (*truth, *(c for choices in settled.values() for c in choices))}
    unused = [k for k in recording if k not in used]
    if unused:
        lines += ["", "# Not used:", *(f"# - {as_yaml(k)}" for k in unused[:_MAX_UNUSED])]
        lines += [f"# and {len(unused) - _MAX_UNUSED} more"] if len(unused) > _MAX_UNUSED else []
    head = [f"# Made from {as_yaml(f)}." for f in _file_names(recording)]
    repair = ["time: {repair: drop}  # the time of some samples repeats or runs backward"] if drop else []
    return "\n".join([_HEAD + "\n".join(head), "only_listed: true", *repair, "", *lines, ""])


def _without(choices: Sequence[Choice], tilted: dict[str, str], recording: Recording) -> list[Choice]:
    """The choices but for the axes of sensors whose axes are not the car's."""
    return [
        c
        for c in choices
        if c.channel not in _SENSOR_AXES or sensor_of(c.key, recording[c.key]) not in tilted
    ]


def _tilted_sensors(settled: dict[str, list[Choice]], recording: Recording) -> dict[str, str]:
    """Inertial sensors on one of whose axes, but not its z upward, gravity lies: name → that axis."""
    found: dict[str, str] = {}
    for axis in "xyz":
        for choice in settled[f"accel_{axis}"]:
            middle = 0.0 if choice.doubt else choice.middle
            if _GRAVITY[0] < abs(middle) < _GRAVITY[1] and (axis != "z" or middle < 0):
                sensor = sensor_of(choice.key, recording[choice.key])
                found[sensor] = ("-" if middle < 0 else "") + axis.upper()
    return found


def _imu_block(sensor: str, up: str, settled: dict[str, list[Choice]], recording: Recording) -> Iterator[str]:
    name = f" of {as_yaml(sensor)}" if sensor else ""
    yield f"# The axes{name} are not the car's: gravity says that {up} points up. Which one points forward?"
    yield f"# rotation: {{up: {up}, forward: ?}}"
    yield "# imu:"
    for kind, channels in IMU_CHANNELS.items():
        parts = []
        for axis, channel in zip("xyz", channels, strict=True):
            of_it = [c for c in settled[channel] if sensor_of(c.key, recording[c.key]) == sensor]
            parts += [f"{axis}: {c.value()}" for c in of_it[:1]]
        if parts:
            yield f"#   {kind}:"
            yield from (f"#     {p}" for p in parts)


def _entries(channel: str, choices: Sequence[Choice]) -> Iterator[str]:
    good = sorted((c for c in choices if not c.doubt), key=lambda c: -c.score)
    doubtful = [c for c in choices if c.doubt]
    best = [c for c in good if c.score > good[0].score - _MARGIN]
    if len(best) == 1:
        yield best[0].line()
    elif best:
        yield f"# {channel}: {len(best)} signals fit equally well; keep one:"
        yield from (f"# {c.line()}" for c in best)
    others = good[len(best) :]
    if others:
        yield f"# {channel} could also be {', '.join(as_yaml(c.key) for c in others[:5])}"
    yield from (f"# {c.line()}" for c in doubtful)


def _needs_repair(recording: Recording) -> bool:
    try:
        for base in {id(s.time): s for s in recording.signals.values()}.values():
            base.check_time()
    except InputError:
        return True
    return False


def _file_names(recording: Recording) -> list[str]:
    return [Path(str(f)).name for f in recording.metadata.get("files") or ()]
