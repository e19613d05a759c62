"""Octaves that were fed, and whether their spectrum is the oracle's."""

import numpy as np
import pytest
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.periodogram import Periodogram
from numpy.typing import NDArray
from numpy_octaves import Lines

Array = NDArray[np.float64]


def fed(y: Array) -> Octaves:
    """Octaves of samples (n, lanes), or (n,) of one lane."""
    rows = np.ascontiguousarray(y.reshape(len(y), -1))
    octaves = Octaves(rows.shape[1])
    octaves.add(rows)
    return octaves


def noise(n: int, lanes: int, seed: int) -> Array:
    return np.random.default_rng(seed).standard_normal((n, lanes))


def check_lines(p: Periodogram, oracle: Lines) -> None:
    """Equal; lines at one frequency are averaged first."""
    lam, place = np.unique(oracle.lam, return_inverse=True)
    assert p.weight is not None
    assert p.lam == pytest.approx(lam, rel=1e-13)
    weight = np.bincount(place, oracle.weight)
    assert p.weight == pytest.approx(weight, rel=1e-12)
    power = np.bincount(place, oracle.weight * oracle.power) / weight
    assert p.power == pytest.approx(power, rel=2e-5, abs=1e-5 * power.mean())
