"""Which of a recording's signals may be which channel: what their names, units and values say."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import yaml
from pydantic import ValidationError

from roadstate.core import CHANNELS, InputError, Recording, Signal
from roadstate.io.mapping import Mapping
from roadstate.io.mapping_channel import is_linear_wheel_speed
from roadstate.io.matching import message_of
from roadstate.io.plausible import limit_of
from roadstate.io.suggest_words import (
    ASIDE,
    AXES,
    LAST_UNIT_WORDS,
    NEUTRAL,
    SPLIT_UNITS,
    TRUTH,
    UNIT_WORDS,
    WORDS,
    Rule,
)

_SURPLUS = 0.25  # score lost for a word that the channel does not explain
_MAX_NAME = 200
_ANY_RADIUS = 0.3  # m; whether a draft applies does not depend on it
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_.@]*")
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue"})


@dataclass(frozen=True)
class Choice:
    """One signal that may be a channel.

    Attributes:
        channel: canonical name.
        key: the raw signal's.
        score: how well it fits, to compare with others of the channel.
        unit: unit to write, where the file gives none.
        valid: the signal of its message that says whether it is valid.
        middle: median in the channel's SI unit.
        remark: what the reader should know.
        doubt: what speaks against it; empty where nothing does.
    """

    channel: str
    key: str
    score: float
    unit: str | None = None
    valid: str | None = None
    middle: float = 0.0
    remark: str = ""
    doubt: str = ""

    def line(self) -> str:
        """The entry as YAML, what is to be said of it behind it."""
        notes = "; ".join(n for n in (self.remark, self.doubt) if n)
        return f"{self.channel}: {self.value()}" + (f"  # {notes}" if notes else "")

    def value(self) -> str:
        """What the channel is made of, as YAML."""
        settings = [f"from: {as_yaml(self.key)}"]
        if self.unit is not None:
            settings.append(f"unit: {as_yaml(self.unit)}")
        if self.valid is not None:
            settings.append(f"valid: {{signal: {as_yaml(self.valid)}, equals: 1}}")
        return settings[0].removeprefix("from: ") if len(settings) == 1 else f"{{{', '.join(settings)}}}"


def choices_for(rule: Rule, recording: Recording) -> list[Choice]:
    """The signals whose names fit a channel; the channel's own name fits it best."""
    found = []
    for key, signal in recording.signals.items():
        if len(key) > _MAX_NAME:
            continue
        if key == rule.channel:
            found.append(Choice(rule.channel, key, 100.0, valid=_flag(key, signal, recording)))
            continue
        words = _words(key)
        surplus = _surplus(rule, words)
        is_aside = ASIDE.search(words) is not None and rule.channel != "brake"
        if surplus is None or is_aside or TRUTH.search(words) or key in CHANNELS:
            continue
        unit, evidence = _unit(rule.channel, words, signal)
        found.append(
            Choice(
                rule.channel,
                key,
                evidence - _SURPLUS * surplus,
                unit=unit,
                valid=_flag(key, signal, recording),
            )
        )
    return found


def truths_for(rule: Rule, recording: Recording) -> Iterator[Choice]:
    """The signals whose names fit a reference channel and say that they are truth."""
    for key, signal in recording.signals.items():
        words = _words(key)
        is_truth = TRUTH.search(words) is not None or rule.channel == "ref_grade"
        if key == rule.channel or (is_truth and _surplus(rule, words) is not None and len(key) <= _MAX_NAME):
            yield Choice(rule.channel, key, 0.0, unit=_unit(rule.channel, words, signal)[0])


def _surplus(rule: Rule, words: str) -> int | None:
    """How many words the channel does not explain; ``None`` where the name does not fit it."""
    if any(WORDS[w].search(words) for w in rule.never):
        return None
    best: int | None = None
    for way in rule.ways:
        if all(WORDS[w].search(words) for w in way):
            rest = words
            for w in way:
                rest = WORDS[w].sub("_", rest)
            rest = NEUTRAL.sub("_", rest)
            left = [w for w in rest.split("_") if w and not w.isdigit()]
            left = [w for w in left if w not in UNIT_WORDS and w not in LAST_UNIT_WORDS]
            best = len(left) if best is None else min(best, len(left))
    return best


@lru_cache(maxsize=8192)
def _words(key: str) -> str:
    """A signal's own name in lower case, its words set off by ``_``: ``ESP_02.YawRate`` → ``_yaw_rate_``."""
    name = key.split("@")[0].rpartition(".")[2].translate(_UMLAUTS)
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name)
    words = "_" + re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") + "_"
    for apart, together in SPLIT_UNITS.items():
        if words.endswith(apart):
            return words.removesuffix(apart) + together
    return words


def _unit(channel: str, words: str, signal: Signal) -> tuple[str | None, float]:
    """The unit to write, if any, and how much the unit speaks for the channel."""
    if channel == "brake":
        return ("-" if signal.unit and signal.unit.strip(" []") not in ("", "-") else None), 0.0
    if signal.unit and signal.unit.strip(" []"):
        return None, 1.0
    split = words.strip("_").split("_")
    for word in split:
        if word in UNIT_WORDS:
            return UNIT_WORDS[word], 1.0
    if split[-1] in LAST_UNIT_WORDS:
        return LAST_UNIT_WORDS[split[-1]], 1.0
    return None, 0.0


def _flag(key: str, signal: Signal, recording: Recording) -> str | None:
    """The one signal of the same message that says 1 where the message is valid."""
    message = signal.message or message_of(key)
    if message is None:
        return None
    flags = [
        k
        for k, s in recording.signals.items()
        if (s.message or message_of(k)) == message
        and s.bus == signal.bus
        and re.search(r"_valid_|_gueltig_|_validity_", _words(k))
        and np.isin(s.values[np.isfinite(s.values)], (0.0, 1.0)).all()
        and (s.values == 1.0).any()
    ]
    return flags[0] if len(flags) == 1 and flags[0] != key else None


def settle(choice: Choice, recording: Recording, drop: bool) -> Choice:
    """The choice as it works on the recording, or with the doubt that speaks against it."""
    name, given = choice.channel, choice.unit or recording[choice.key].unit
    result = _trial(choice, recording, drop)
    limit = limit_of(name)
    if isinstance(result, InputError) and not given and limit is not None:
        guesses = (replace(choice, unit=u, remark="unit guessed from the magnitude") for u in limit.units)
        trials = ((guess, _trial(guess, recording, drop)) for guess in guesses)
        choice, result = next(((g, t) for g, t in trials if isinstance(t, Signal)), (choice, result))
    if isinstance(result, InputError):
        is_share = name == "engine_torque" and given is not None and given.strip(" []") == "%"
        what = "per cent of a torque: give that as scale, such as '320 N*m'" if is_share else result.what
        return replace(choice, doubt=_comment(what))
    if not choice.remark and not given and CHANNELS[name].unit != "-":
        choice = replace(choice, remark=f"no unit given: taken to be in {CHANNELS[name].unit}")
    elif given and is_linear_wheel_speed(name, given):
        choice = replace(choice, remark="along the road: needs the wheel radius of a vehicle file")
    values = result.values[np.isfinite(result.values)]
    return replace(choice, middle=float(np.median(values)) if len(values) else 0.0)


def _trial(choice: Choice, recording: Recording, drop: bool) -> Signal | InputError:
    """The channel that the choice would give, or why it gives none."""
    entry: dict[str, object] = {"from": choice.key}
    if choice.unit is not None:
        entry["unit"] = choice.unit
    if choice.valid is not None:
        entry["valid"] = {"signal": choice.valid, "equals": 1}
    content = {
        "channels": {choice.channel: entry},
        "only_listed": True,
        "time": {"repair": "drop" if drop else "error"},
    }
    try:
        applied = Mapping.model_validate(content).apply(recording, wheel_radius=_ANY_RADIUS)
    except InputError as error:
        return error
    except ValidationError as error:
        return InputError(error.errors()[0]["msg"].removeprefix("Value error, "))
    return applied[choice.channel]


def sensor_of(key: str, signal: Signal) -> str:
    """What tells one inertial sensor's axes from another's: the message, or the first word of the name."""
    first = _words(key).split("_")[1]
    is_axis = any(WORDS[w].search(f"_{first}_") for w in AXES)
    return signal.message or message_of(key) or ("" if is_axis else first)


def _comment(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text)


def as_yaml(text: str) -> str:
    """A text as YAML: bare where nothing can go wrong, else in quotes with everything odd escaped."""
    if _PLAIN.fullmatch(text) and text != "null":
        return text
    if text in ("m/s^2", "deg/s", "rad/s", "km/h", "m/s", "N*m"):
        return text
    quoted: str = yaml.safe_dump(text, default_style='"', width=10_000, allow_unicode=False)
    return quoted.strip()
