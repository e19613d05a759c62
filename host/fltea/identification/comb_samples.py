"""Find the pattern that makes a comb of spectral lines, and remove it from the samples.

A comb comes from a pattern that recurs in each period. The record is folded: all its periods are laid over
each other. A phase is a position within the period. The mean of all samples at each phase is the pattern.

A pattern that fills only a small part of the period is a glitch. The samples in a glitch tell nothing about
the noise. They are replaced by random ones, as lost samples are (`gaps`). So the glitches of different
periods need not be alike. A pattern that fills more of the period is a wave. Its harmonics (oscillations at
multiples of the comb's frequency) are subtracted.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.identification.gaps import LONGEST_BRIDGE, Stretch, redrawn
from fltea.records.arrays import Array, Mask
from fltea.spectrum.comb import FEWEST_PERIODS, Comb

MOST_OF_A_PERIOD = 0.25
"""A pattern counts as a glitch if it is at most this fraction of the period long; a longer pattern counts as
a wave.
"""
STANDS_OUT = 4.0
"""A phase of the period belongs to the glitch if the mean at this phase is more than this many standard
errors from the usual mean.
"""
MARGIN = 1
"""A glitch is widened by this number of phases (positions within the period) on each side, since it may begin
between two samples.
"""
LEAST_SIGN, NEARLY_ALL = 3.3, 0.85
"""Thresholds for the number of periods that show the average pattern.

Of n periods, about n/2 seem to show the pattern by chance, with a standard deviation of √n/2. So the number
must exceed n/2 by more than LEAST_SIGN times √n/2. If n is small, that may be more than all periods. So an
excess of more than NEARLY_ALL times n/2 is enough, too.
"""
SEEN = 12.0
"""A harmonic (an oscillation at a multiple of the comb's frequency) is subtracted only if its power exceeds
this many times the mean power of noise at that frequency.

Noise alone exceeds this limit once in 160,000 cases.
"""


class WithoutComb(NamedTuple):
    """A record from which the pattern behind a comb of lines was removed."""

    stretches: list[Stretch]
    shape: Literal["glitch", "wave"]
    share: float
    """Fraction of the record's power that was in the comb."""
    samples: int
    """Length of the glitch in samples; 0 if the pattern is a wave."""
    size: float
    """Largest distance of the pattern from its median, in standard deviations of the noise."""


class _Folded(NamedTuple):
    """A folded stretch of samples: each sample has a phase, which is its position within the period."""

    phase: NDArray[np.intp]
    """Phase of each sample, (n,), a whole number below the number of phases."""
    period: NDArray[np.intp]
    """Index of the period that contains each sample, (n,)."""
    values: Array
    """Each sample minus the mean of the comb's period that contains it, (n,). The same constant is then
    subtracted from all values, so that the median of `profile` is 0.
    """
    profile: Array
    """Mean of `values` at each phase, (phases,)."""
    spread: float
    """Standard deviation of `values` about `profile`."""


def without_comb(stretches: Sequence[Stretch], comb: Comb) -> WithoutComb | None:
    """Return the stretches without the pattern that each period repeats.

    Returns None if only a few periods have the pattern.
    """
    longest = max(range(len(stretches)), key=lambda i: len(stretches[i].y))
    y, found = stretches[longest].y, _folded(stretches[longest].y, comb.period)
    core = _glitch(found)
    if not _in_most_periods(found, np.ones(len(found.profile), dtype=bool) if core is None else core):
        return None
    size = float(np.abs(found.profile).max()) / max(found.spread, 1e-300)
    if core is None:
        parts = [_without_wave(one, comb.period, found) for one in stretches]
        share = 1 - float(parts[longest].y.var()) / float(y.var())
        return WithoutComb(parts, "wave", max(share, 0.0), 0, size)
    masks = [np.zeros(len(one.y), dtype=bool) for one in stretches]
    for i, one in enumerate(stretches):
        if len(one.y) >= FEWEST_PERIODS * comb.period:
            own = found if i == longest else _folded(one.y, comb.period)
            window = core if i == longest else _glitch(own)
            if window is not None:
                masks[i] = _widened(window)[own.phase]
    if _longest_run(masks[longest]) <= LONGEST_BRIDGE:
        parts = redrawn(stretches, masks)
    else:
        parts = [_without_profile(*both, comb.period) for both in zip(stretches, masks, strict=True)]
    inside = found.values[masks[longest]]
    excess = float(inside @ inside) - len(inside) * found.spread**2
    share = min(max(excess / float(found.values @ found.values), 0.0), 1.0)
    return WithoutComb(parts, "glitch", share, int(core.sum()), size)


def _folded(y: Array, period: float) -> _Folded:
    phases = int(period)
    turns = np.arange(len(y)) / period
    number = turns.astype(np.intp)
    phase = np.minimum(((turns - number) * phases).astype(np.intp), phases - 1)
    level = np.bincount(number, y) / np.maximum(np.bincount(number), 1)
    values = y - level[number]
    profile = np.bincount(phase, values, phases) / np.maximum(np.bincount(phase, minlength=phases), 1)
    usual = float(np.median(profile))
    values -= usual
    profile -= usual
    return _Folded(phase, number, values, profile, _scale(values - profile[phase]))


def _scale(values: Array) -> float:
    return 1.4826 * float(np.median(np.abs(values)))


def _glitch(found: _Folded) -> Mask | None:
    """Return a mask of the phases that belong to the glitch, (phases,); None if the pattern is a wave."""
    error = max(_scale(found.profile), found.spread / math.sqrt(len(found.values) / len(found.profile)))
    core = np.abs(found.profile) > STANDS_OUT * error
    if not core.any() or _widened(core).mean() > MOST_OF_A_PERIOD:
        return None
    return core


def _widened(core: Mask) -> Mask:
    return np.asarray(np.any([np.roll(core, by) for by in range(-MARGIN, MARGIN + 1)], axis=0))


def _in_most_periods(found: _Folded, window: Mask) -> bool:
    """Return whether most periods show the pattern.

    Each period is compared with the mean of all other periods.
    """
    periods = int(found.period[-1])  # without the last period, which is incomplete
    inside = window[found.phase]
    values = np.where(inside, found.values, 0.0)
    alike = np.bincount(found.period, values * (found.profile[found.phase] - values / max(periods, 1)))
    positive = int((alike[:periods] > 0).sum())
    root = math.sqrt(periods)
    return positive - periods / 2 > min(LEAST_SIGN, NEARLY_ALL * root) * root / 2


def _longest_run(mask: Mask) -> int:
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)
    return int((edges[:, 1] - edges[:, 0]).max(initial=0))


def _without_profile(one: Stretch, mask: Mask, period: float) -> Stretch:
    """Return a stretch from which the pattern was subtracted at the samples where `mask` is true."""
    if not mask.any():
        return one
    own = _folded(one.y, period)
    return one._replace(y=one.y - np.where(mask, own.profile[own.phase], 0.0))


def _without_wave(one: Stretch, period: float, found: _Folded) -> Stretch:
    """Return a stretch from which a wave was subtracted.

    The wave consists of the harmonics that stand out in the longest stretch (`found`).
    """
    amplitudes = np.fft.rfft(found.profile)
    noise = found.spread**2 * len(found.profile) ** 2 / len(found.values)
    orders = np.flatnonzero(np.abs(amplitudes[1:]) ** 2 > SEEN * noise) + 1
    y, mean = one.y.copy(), float(one.y.mean())
    turn = 2 * np.pi / period * np.arange(len(y))
    for order in orders.tolist():
        wave = np.exp(1j * order * turn)
        y -= 2 * np.real(np.vdot(wave, one.y - mean) / len(y) * wave)
    return one._replace(y=y)
