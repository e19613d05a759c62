"""Tests which samples count as noise in the spectrum: outliers of heavy-tailed noise count. Short motions
(knocks), steps and gaps do not.
"""

from collections.abc import Callable

import numpy as np
import pytest
from fltea.records.arrays import Array
from fltea.spectrum.octaves import Counts, Octaves
from fltea.spectrum.periodogram import Periodogram

from tests.rig.identify_support import H, long_recursion
from tests.rig.numpy_octaves import fed


def noise(n: int, seed: int = 1) -> Array:
    return np.random.default_rng(seed).standard_normal(n)


def mean_power(p: Periodogram) -> float:
    return float(np.average(p.power, weights=p.weight))


@pytest.mark.parametrize(
    ("make", "most"),
    [
        pytest.param(lambda: noise(1_000_000), 0, id="Gaussian"),
        pytest.param(lambda: np.random.default_rng(2).standard_t(4, 1_000_000), 999, id="t4"),
        pytest.param(lambda: np.rint(noise(1_000_000)), 999, id="one LSB"),
        pytest.param(lambda: np.rint(0.2 * noise(1_000_000)), 999, id="a fifth of an LSB"),
        pytest.param(lambda: np.rint(0.13 * noise(1_000_000)), 999, id="an eighth of an LSB"),
        pytest.param(lambda: np.random.default_rng(3).laplace(size=1_000_000), 0, id="Laplace"),
        pytest.param(lambda: long_recursion(1.2, -0.01, 1_000_000, 3), 999, id="strong memory"),
        pytest.param(lambda: np.cumsum(noise(1_000_000)), 0, id="random walk"),
        pytest.param(lambda: noise(1_000_000) + 1e-5 * np.arange(1_000_000), 999, id="drift"),
        pytest.param(lambda: noise(1_000_000) + 5 * np.sin(np.arange(1_000_000) * 0.7), 999, id="line"),
    ],
)
def test_nothing_is_cut_from_noise(make: Callable[[], Array], most: int) -> None:
    """No sample of noise is left out. Outliers are limited in size, which happens to at most `most` of a
    million samples.
    """
    y = make()
    counts = fed(y).counts(0)
    assert counts._replace(limited=0) == Counts(len(y), 0, 0, 0, 0, 0, 0, 0, False)
    assert counts.limited <= most


def test_outliers_are_limited_and_counted() -> None:
    """Outliers are limited in size and counted. If these three outliers, which are close together, kept their
    size, they would change the shape of the spectrum.
    """
    y = noise(60_000)
    y[[20_003, 20_005, 20_007]] += np.array([25, -25, 25])
    octaves = fed(y)
    counts = octaves.counts(0)
    assert (counts.limited, counts.knocks, counts.used) == (3, 0, 60_000)
    p, still = octaves.periodogram(0, H), fed(noise(60_000)).periodogram(0, H)
    assert np.allclose(mean_power(p), mean_power(still), rtol=0.02)


def test_a_knock_is_left_out_and_counted() -> None:
    y = noise(60_000)
    y[20_000:20_200] += 30 * np.sin(np.arange(200) * 0.9)
    y[40_000:40_010] = 500
    octaves = fed(y)
    counts = octaves.counts(0)
    assert (counts.knocks, counts.steps, counts.changes) == (3, 0, 0)
    assert counts.knocked == 3 * 128
    assert counts.used == 60_000 - 3 * 128
    assert mean_power(octaves.periodogram(0, H)) == pytest.approx(1, abs=0.04)


@pytest.mark.parametrize("height", [1.5, 3.0, 8.0, 1e6])
@pytest.mark.parametrize("at", [30_000, 30_016, 30_080])
def test_a_step_of_the_offset_is_a_break(height: float, at: int) -> None:
    """A step of the offset is left out of the spectrum. A large step looks like a short motion (knock) in its
    chunk of samples, and may count as one.
    """
    y = noise(60_000)
    y[at:] += height
    octaves = fed(y)
    counts = octaves.counts(0)
    assert 1 <= counts.steps + counts.knocks <= 2
    assert counts.changes == 0
    p = octaves.periodogram(0, H)
    low = p.lam < 0.03
    assert np.average(p.power[low], weights=p.weight[low]) == pytest.approx(1, abs=0.35)
    assert mean_power(p) == pytest.approx(1, abs=0.04)


def test_a_new_level_is_taken_after_eight_chunks() -> None:
    y = noise(60_000)
    y[30_080:] *= 10
    counts = fed(y).counts(0)
    assert (counts.knocks, counts.changes, counts.knocked) == (8, 1, 1024)


def test_noise_of_which_the_mean_begins_to_wander_is_not_cut_for_ever() -> None:
    y = noise(200_000)
    y[50_000:] += np.cumsum(0.3 * noise(150_000, 2))
    counts = fed(y).counts(0)
    assert counts.steps < 60
    assert counts.used > 190_000


def test_a_constant_lane() -> None:
    octaves = fed(np.full(5000, 0.1))
    assert octaves.counts(0) == Counts(5000, 0, 0, 0, 0, 0, 0, 0, True)
    octaves.add(np.array([[0.1], [0.2]]))
    assert not octaves.counts(0).constant


@pytest.mark.parametrize(
    ("seen", "lost", "bridged"), [(1000, 1, 1), (999, 1, 0), (8000, 8, 8), (50_000, 9, 0)]
)
def test_what_is_bridged(seen: int, lost: int, bridged: int) -> None:
    octaves = fed(noise(seen))
    octaves.skip(lost)
    octaves.add(noise(500, 2)[:, np.newaxis])
    counts = octaves.counts(0)
    assert (counts.bridged, counts.lost, counts.gaps) == (bridged, lost, int(bridged == 0))
    assert counts.used == octaves.samples == seen + 500


def test_at_most_one_sample_in_a_thousand_is_made_up() -> None:
    octaves = Octaves(1)
    for k in range(200):
        octaves.add(noise(400, k)[:, np.newaxis])
        octaves.skip(1)
    counts = octaves.counts(0)
    assert counts.lost == 200
    assert counts.bridged <= 80_000 / 1000
    # a lost sample is replaced (bridged) or counts as a gap, but not the last one: no sample came after it
    assert counts.bridged + counts.gaps == 199
    assert mean_power(octaves.periodogram(0, H)) == pytest.approx(1, abs=0.03)


def test_losses_before_the_first_sample_are_no_gap() -> None:
    octaves = Octaves(1)
    octaves.skip(1000)
    octaves.add(noise(1000)[:, np.newaxis])
    counts = octaves.counts(0)
    assert (counts.lost, counts.gaps, counts.used) == (1000, 0, 1000)
