"""Random unevenness against ISO 8608: spectrum, coherence, slopes, repeatability."""

from __future__ import annotations

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
    assert knots[:, 0, 1] / 0.05 == pytest.approx(derivative, abs=1e-9)


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


@pytest.mark.parametrize(("length", "width"), [(50.0, 2.0), (100.0, 0.0), (1e6, 50.0)])
def test_sizes_that_cannot_be_are_refused(length: float, width: float) -> None:
    with pytest.raises(InputError, match="rough surface"):
        rough_surface("A", 0, length, width)
