"""Compute the running spectrum from all samples at once by numpy, as an oracle of the native code.

The spectrum consists of octaves: each level has half the sampling rate of the level before.
"""

from typing import NamedTuple

import numpy as np
import pytest
from fltea.records.arrays import Array
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.periodogram import Periodogram
from scipy import signal

TAPS = signal.firwin(31, 0.5, window=("kaiser", 8.0))
WINDOW = signal.get_window("hann", 256)


class Lines(NamedTuple):
    """Spectral lines in rising frequency; several lines at one frequency stay separate."""

    lam: Array
    power: Array
    weight: Array
    depth: int
    blocks: tuple[int, ...]


def _correlated(later: int) -> float:
    """Return how strongly the spectra of two blocks of white noise are correlated. The second block begins
    `later` samples later.

    The result is a sum over all lines of the second spectrum: the squared correlation of each with one line
    of the first.
    """
    both = np.zeros(256)
    both[: 256 - later] = WINDOW[later:] * WINDOW[: 256 - later]
    return float((np.abs(np.fft.fft(both)) ** 2).sum() / (WINDOW**2).sum() ** 2)


def lines(stretches: list[Array], made_up: list[Array] | None = None) -> Lines:
    """Return the spectrum of a record that is given as stretches (runs of samples without gaps).

    `made_up`: for each stretch, an array that is True where a sample was filled in instead of measured.
    """
    lam, power, weight, all_blocks, level = [], [], [], [], 0
    while sum(len(x) for x in stretches if len(x) >= 64) > 3072:
        blocks = [
            x[begin : begin + 256]
            for k, x in enumerate(stretches)
            for begin in range(0, len(x) - 255, 128)
            if level > 0 or made_up is None or not made_up[k][begin : begin + 256].any()
        ]
        bins = np.arange(45, 90 if level else 128)
        if blocks:
            found = np.abs(np.fft.rfft(np.array(blocks) * WINDOW)[:, bins]) ** 2 / (WINDOW**2).sum()
            lam.append(2 * np.pi * bins / 256 / 2**level)
            power.append(found.mean(axis=0) * 2**level / passed(lam[-1], level))
            k = len(blocks)
            weight.append(np.full(len(bins), k / (_correlated(0) + 2 * _correlated(128) * (1 - 1 / k))))
        all_blocks.append(len(blocks))
        stretches = [np.convolve(x, TAPS, "valid")[::2] for x in stretches if len(x) >= len(TAPS)]
        level += 1
    for x in stretches:
        if len(x) < 64:
            continue
        own = 2 * np.pi * np.arange(4, (len(x) - 1) // 2 + 1) / len(x)
        if level:
            own = own[own < 2 * np.pi * 89 / 256]
        lam.append(own / 2**level)
        drift = np.polynomial.Polynomial.fit(np.arange(len(x)), x, 3 if level else 0)
        found = np.abs(np.fft.rfft(x - drift(np.arange(len(x))))[4 : 4 + len(own)]) ** 2 / len(x)
        power.append(found * 2**level / passed(lam[-1], level))
        weight.append(np.ones(len(own)))
    at, order = np.concatenate(lam), np.argsort(np.concatenate(lam), kind="stable")
    return Lines(
        at[order], np.concatenate(power)[order], np.concatenate(weight)[order], level, tuple(all_blocks)
    )


def passed(lam: Array, level: int) -> Array:
    """Return the power gain of all low-passes before a level of the running spectrum. Each halving of the
    sampling rate has one low-pass.

    `lam`: frequency [rad per original sample].
    """
    result = np.ones_like(lam)
    for halvings in range(level):
        result *= np.abs(signal.freqz(TAPS, worN=lam * 2**halvings)[1]) ** 2
    return result


def fed(y: Array) -> Octaves:
    """Return the native running spectrum of samples, of shape (n, axes), or (n,) for one axis."""
    rows = np.ascontiguousarray(y.reshape(len(y), -1))
    octaves = Octaves(rows.shape[1])
    octaves.add(rows)
    return octaves


def noise(n: int, lanes: int, seed: int) -> Array:
    return np.random.default_rng(seed).standard_normal((n, lanes))


def check_lines(p: Periodogram, oracle: Lines) -> None:
    """Check that a native spectrum equals the oracle's. The native spectrum has one line for each frequency.
    If the oracle has several, their weighted mean is compared with it.
    """
    lam, place = np.unique(oracle.lam, return_inverse=True)
    assert p.weight is not None
    assert p.lam == pytest.approx(lam, rel=1e-13)
    weight = np.bincount(place, oracle.weight)
    assert p.weight == pytest.approx(weight, rel=1e-12)
    power = np.bincount(place, oracle.weight * oracle.power) / weight
    assert p.power == pytest.approx(power, rel=2e-5, abs=1e-5 * power.mean())
