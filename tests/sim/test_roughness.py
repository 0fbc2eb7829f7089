"""Random unevenness against ISO 8608: spectrum, coherence, slopes, repeatability."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from roadstate.core import InputError
from roadstate.sim.roads import rough_surface
from roadstate.sim.roads.roughness import CLASSES, coherence, displacement_psd


def spectra(road_class: str, seeds: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """n, one-sided PSD (seeds, n, lines) and complex spectra of independent surfaces."""
    heights = [np.asarray(rough_surface(road_class, seed, 500.0, 2.0).knots[..., 0]) for seed in range(seeds)]
    waves = np.fft.rfft(np.stack(heights), axis=1) / heights[0].shape[0]
    frequency = np.arange(waves.shape[1]) / 500.0
    return frequency, 2 * np.abs(waves) ** 2 * 500.0, waves


@pytest.mark.parametrize("road_class", sorted(CLASSES))
def test_spectrum_is_that_of_the_class_in_every_octave(road_class: str) -> None:
    n, psd, _ = spectra(road_class, seeds=4)
    for low in 0.0125 * 2.0 ** np.arange(7):
        band = (n >= low) & (n < 2 * low)
        ratio = psd[:, band].mean(axis=(0, 2)) / displacement_psd(n[band], road_class)
        # each bin is χ² with 8 degrees of freedom per line; lines 0.25 m apart are hardly independent
        assert ratio.mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / (8 * band.sum())))


def test_class_is_sixteen_micrometres_cubed_at_the_reference() -> None:
    assert displacement_psd(np.array([0.1, 0.2]), "A") == pytest.approx([16e-6, 4e-6])
    with pytest.raises(InputError, match="no road class 'F'"):
        displacement_psd(np.array([0.1]), "F")


def test_nothing_lies_outside_the_range_of_the_standard() -> None:
    n, psd, _ = spectra("B", seeds=1)
    outside = (n < 0.0109) | (n > 2.831)
    assert psd[:, outside].max() < 1e-20
    assert psd[:, ~outside].min() > 0


@pytest.mark.parametrize("line", [1, 4, 8])
def test_coherence_across_falls_as_isotropy_asks(line: int) -> None:
    n, _, waves = spectra("C", seeds=40)
    for low, high in ((0.02, 0.06), (0.1, 0.3), (0.5, 1.5)):
        band = (n >= low) & (n < high)
        a, b = waves[:, band, 0], waves[:, band, line]
        cross = np.mean(np.real(a * np.conj(b)), axis=0) / displacement_psd(n[band], "C")
        own = np.mean(np.abs(a) ** 2, axis=0) / displacement_psd(n[band], "C")
        expected = coherence(n[band], np.asarray(0.25 * line)).mean()
        assert np.mean(cross) / np.mean(own) == pytest.approx(expected, abs=0.08)


def test_coherence_is_a_bessel_function() -> None:
    special = pytest.importorskip("scipy.special")
    x = np.linspace(0.002, 30.0, 500)
    assert coherence(x / (2 * np.pi), np.asarray(1.0)) == pytest.approx(x * special.k1(x), abs=1e-9)
    assert coherence(np.array([0.0]), np.asarray(1.5)) == pytest.approx([1.0])


def test_slopes_at_the_knots_are_those_of_the_waves() -> None:
    surface = rough_surface("D", 5, 200.0, 1.0)
    knots = np.asarray(surface.knots)
    spectrum = np.fft.rfft(knots[:, 0, 0])
    derivative = np.fft.irfft(spectrum * 2j * np.pi * np.arange(len(spectrum)) / 200.0, len(knots))
    assert knots[:, 0, 2] / 0.05 == pytest.approx(derivative, abs=1e-9)


def test_surface_repeats_without_a_step() -> None:
    surface = rough_surface("B", 2, 100.0, 2.0)
    s, d = np.linspace(-7.0, 107.0, 400), np.full(400, 0.3)
    here, again = surface.at(s, d), surface.at(s + 100.0, d)
    for a, b in zip(here, again, strict=True):
        assert np.asarray(a) == pytest.approx(np.asarray(b), abs=1e-12)
    near = np.asarray(surface.at(np.array([100.0 - 1e-9, 100.0 + 1e-9]), np.zeros(2))[0])
    assert near[0] == pytest.approx(near[1], abs=1e-9)


def test_same_seed_same_bits_another_seed_another_road() -> None:
    a, b, c = (np.asarray(rough_surface("B", seed, 100.0, 1.0).knots) for seed in (7, 7, 8))
    assert np.array_equal(a, b)
    assert not np.allclose(a, c)


def test_a_wide_and_long_surface_needs_little_beside_itself() -> None:
    tracemalloc.start()
    try:
        surface = rough_surface("B", 7, 1000.0, 20.0)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < 8 * surface.knots.nbytes
    # the coherences of all frequencies at once, of 241 numbers each
    assert most < 8 * 2820 * surface.knots.shape[1] * 241


def test_surface_does_not_depend_on_how_much_is_reckoned_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = np.asarray(rough_surface("B", 7, 100.0, 2.0).knots)
    monkeypatch.setattr("roadstate.sim.roads.roughness._BLOCK", 25_000)
    assert np.array_equal(rough_surface("B", 7, 100.0, 2.0).knots, whole)


@pytest.mark.parametrize(("length", "width"), [(50.0, 2.0), (100.0, 0.0), (1e6, 50.0)])
def test_sizes_that_cannot_be_are_refused(length: float, width: float) -> None:
    with pytest.raises(InputError, match="rough surface"):
        rough_surface("A", 0, length, width)


def test_slopes_are_continuous_across_lines_and_rows_and_at_the_sides() -> None:
    surface = rough_surface("C", 4, 100.0, 2.0)
    s = np.linspace(0.013, 99.0, 300)
    tiny = 1e-9
    jumps = []
    for line in np.arange(-1.0, 1.01, 0.25):
        near, far = (surface.at(s, np.full(300, line + side * tiny)) for side in (-1, 1))
        for a, b in zip(near, far, strict=True):
            jumps.append(np.abs(np.asarray(a) - np.asarray(b)).max())
    rows = 0.05 * np.arange(1, 300)
    d = np.full(299, 0.09)
    for a, b in zip(surface.at(rows - tiny, d), surface.at(rows + tiny, d), strict=True):
        jumps.append(np.abs(np.asarray(a) - np.asarray(b)).max())
    assert max(jumps) < 1e-6
    # which is not because there is nothing that could jump
    tilt = np.asarray(surface.at(s, np.full(300, 0.1))[2])
    assert np.sqrt(np.mean(tilt**2)) > 0.01


def test_slopes_are_the_derivatives_of_the_height() -> None:
    surface = rough_surface("D", 6, 100.0, 3.0)
    rng = np.random.default_rng(2)
    s, d, h = rng.uniform(0, 100, 500), rng.uniform(-1.7, 1.7, 500), 1e-6
    _, along, across = (np.asarray(a) for a in surface.at(s, d))
    by_s = (np.asarray(surface.at(s + h, d)[0]) - np.asarray(surface.at(s - h, d)[0])) / (2 * h)
    by_d = (np.asarray(surface.at(s, d + h)[0]) - np.asarray(surface.at(s, d - h)[0])) / (2 * h)
    assert along == pytest.approx(by_s, abs=1e-5)
    assert across == pytest.approx(by_d, abs=1e-5)
    assert np.abs(across[np.abs(d) > 1.5]).max() == 0


def test_spectrum_between_the_lines_is_nearly_that_on_them() -> None:
    """Halfway between two lines waves over 2 m lose less than 10 % of their power, over 1 m under 25 %."""
    s = 0.1 * np.arange(2000)
    ratios = []
    for seed in range(12):
        surface = rough_surface("B", seed, 200.0, 1.5)
        on, between = (
            np.abs(np.fft.rfft(np.asarray(surface.at(s, np.full(2000, d))[0]))) ** 2 for d in (0.0, 0.125)
        )
        ratios.append([on, between])
    n = np.arange(1001) / 200.0
    on, between = np.mean(ratios, axis=0)
    for low, high, least in ((0.05, 0.5, 0.9), (0.5, 1.0, 0.75)):
        band = (n >= low) & (n < high)
        weight = n[band] ** 2  # so that each frequency counts alike
        ratio = np.sum(weight * between[band]) / np.sum(weight * on[band])
        assert least < ratio < 1.1
