"""What a sensor does to one signal: band, delay, sampling, scale, bias, noise, range, resolution."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError

Array = NDArray[np.floating[Any]]
_TAIL = 20.0  # time constants after which the low pass has forgotten to 1e-8


@dataclass(frozen=True)
class Probe:
    """A sensor of one signal. The defaults are an ideal one; figures are in the signal's SI unit.

    The reading at t is quantised(limited((1 + gain) x(t − delay + jitter) + bias + walk + wander + noise)),
    with x the signal after the low pass.

    Attributes:
        rate: samples per second, Hz.
        bandwidth: −3 dB frequency of a Butterworth low pass of second order, Hz; none without one. Its own
            delay at low frequency is √2/(2π·bandwidth).
        delay: of the reading, s.
        jitter: 1σ of the sampling instants about their time stamps, s.
        gain: relative error, the value.
        gain_std: 1σ of a relative error that is drawn once.
        offset: constant error, the value.
        bias: 1σ of a constant error that is drawn once.
        walk: random walk of the bias: 1σ after t seconds is walk·√t.
        wander: 1σ of an error that is correlated in time (Gauss–Markov), stationary from the start.
        wander_time: its correlation time, s.
        noise_density: white noise n: a sample at f Hz has 1σ = n·√f, its integral over t seconds n·√t.
        noise: 1σ of white noise of each sample, on top.
        resolution: step of the readings; 0 for none.
        limit: largest reading, either way.
        least: smallest reading, where it has one: 0 of what cannot be negative.
        is_magnitude: reads amounts only, and nothing where there is nothing, as what counts or presses does.
    """

    rate: float = 100.0
    bandwidth: float | None = None
    delay: float = 0.0
    jitter: float = 0.0
    gain: float = 0.0
    gain_std: float = 0.0
    offset: float = 0.0
    bias: float = 0.0
    walk: float = 0.0
    wander: float = 0.0
    wander_time: float = 30.0
    noise_density: float = 0.0
    noise: float = 0.0
    resolution: float = 0.0
    limit: float = np.inf
    least: float | None = None
    is_magnitude: bool = False

    def __post_init__(self) -> None:
        signed = ("gain", "offset", "least")
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None or field.name == "is_magnitude":
                continue
            endless = field.name == "limit" and value == np.inf
            if not (np.isfinite(value) or endless) or (value < 0 and field.name not in signed):
                raise InputError(f"a sensor's {field.name} is {value}", mend="give a number of 0 or more")
        if not 0.01 <= self.rate <= 10_000 or self.wander_time == 0 or self.bandwidth == 0:
            raise InputError(
                f"a sensor with rate {self.rate:g} Hz, bandwidth {self.bandwidth} Hz, "
                f"wander_time {self.wander_time:g} s",
                mend="choose a rate of 0.01 to 10000 Hz and the others above 0",
            )

    def read(self, time: Array, values: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        """Time stamps (N,) in s and readings (N,).

        Args:
            time: (T,) of the truth, equidistant, s.
            values: (T,) the truth.
            rng: of this sensor alone; the same generator gives the same bits.
        """
        stamps = time[0] + np.arange(int((time[-1] - time[0]) * self.rate + 1e-9) + 1) / self.rate
        # drawn in one order whatever is zero, so that one figure's change leaves the others' draws alone
        once, count = rng.standard_normal(2), len(stamps)
        late, walk, wander, white = (rng.standard_normal(count) for _ in range(4))
        smooth = low_pass(values, time[1] - time[0], self.bandwidth) if len(time) > 1 else values
        seen = np.interp(stamps - self.delay + self.jitter * late, time, smooth)
        step = 1 / self.rate
        error = self.offset + self.bias * once[1] + self.walk * np.sqrt(step) * np.cumsum(walk)
        if self.wander > 0:
            error = error + self.wander * gauss_markov(wander, step / self.wander_time)
        error = error + np.hypot(self.noise, self.noise_density * np.sqrt(self.rate)) * white
        reading = (1 + self.gain + self.gain_std * once[0]) * seen + error
        if self.is_magnitude:
            reading = np.where(seen == 0, 0.0, np.abs(reading))
        reading = np.clip(reading, -self.limit if self.least is None else self.least, self.limit)
        if self.resolution > 0:
            reading = self.resolution * np.round(reading / self.resolution)
        return stamps, reading


def low_pass(values: Array, step: float, bandwidth: float | None) -> Array:
    """A signal after a Butterworth low pass of second order that has seen its first value for ever.

    Args:
        values: (T,) equidistant.
        step: s.
        bandwidth: −3 dB frequency, Hz; one above 0.4 of the sampling rate does nothing.
    """
    if bandwidth is None or bandwidth * step > 0.4:
        return values
    omega = 2 * np.pi * bandwidth
    a = omega / np.sqrt(2)
    t = step * np.arange(min(int(_TAIL / (a * step)) + 2, 10 * len(values) + 100))
    response = np.exp(-a * t) * np.sin(a * t)
    response /= response.sum()
    size = len(values) + len(response)
    moved = values - values[0]
    product = np.fft.rfft(moved, size) * np.fft.rfft(response, size)
    filtered: Array = values[0] + np.fft.irfft(product, size)[: len(values)]
    return filtered


def gauss_markov(shocks: Array, step: float) -> Array:
    """A stationary first-order process of unit variance.

    Args:
        shocks: (N,) independent normal numbers, the first of which is where it starts.
        step: time step over correlation time.
    """
    keep = np.exp(-step)
    scaled = np.sqrt(1 - keep**2) * shocks
    out = np.empty_like(shocks)
    last = out[0] = shocks[0]
    for i in range(1, len(shocks)):
        last = out[i] = keep * last + scaled[i]
    return out
