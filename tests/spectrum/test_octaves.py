"""The running spectrum, compared with numpy on all samples at once, and with theory."""

from collections.abc import Callable

import numpy as np
import pytest
from fltea import _native
from fltea._native import AllanSums
from fltea.noise import spectra
from fltea.spectrum.octaves import LANE_BYTES, WHOLE, Octaves
from fltea.spectrum.periodogram import Periodogram, binned, periodogram
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.identify_support import H, long_recursion
from tests.rig.numpy_octaves import TAPS, check_lines, fed, lines, noise


def test_filter_is_that_of_scipy() -> None:
    angle = np.linspace(0, np.pi, 50)
    gain = TAPS[15] + 2 * sum(TAPS[k] * np.cos((15 - k) * angle) for k in range(15))
    assert _native.half_band_gains(angle) == pytest.approx(gain, abs=1e-15)


def test_memory_of_a_lane_is_bounded() -> None:
    assert LANE_BYTES <= 64 * 1024


@settings(deadline=None, max_examples=30)
@given(st.integers(140, WHOLE), st.integers(0, 99), st.floats(-1e3, 1e3))
def test_a_short_record_is_its_periodogram(n: int, seed: int, offset: float) -> None:
    y = noise(n, 1, seed) + offset
    ours, whole = fed(y).periodogram(0, H), periodogram(y[:, 0], H)
    assert ours.n == whole.n
    assert ours.lam == pytest.approx(whole.lam, rel=1e-14)
    assert ours.power == pytest.approx(whole.power, abs=2e-6 * whole.power.mean(), rel=1e-6)
    assert ours.weight == pytest.approx(np.ones(len(whole.lam)))
    alike = whole._replace(weight=np.ones(len(whole.lam)))
    for ours_too, other in zip(binned(ours), binned(alike), strict=True):
        assert ours_too == pytest.approx(other, rel=1e-5, abs=1e-6)


@pytest.mark.slow
@settings(deadline=None, max_examples=30)
@given(st.integers(WHOLE + 1, 60_000), st.integers(0, 99))
def test_a_long_record_is_what_numpy_makes_of_it(n: int, seed: int) -> None:
    y = np.cumsum(noise(n, 1, seed), axis=0) / 30 + noise(n, 1, seed + 100)
    octaves, oracle = fed(y), lines([y[:, 0]])
    check_lines(octaves.periodogram(0, H), oracle)
    assert octaves.samples == octaves.counts(0).used == n


@pytest.mark.slow
@settings(deadline=None, max_examples=30)
@given(st.data())
def test_stretches_between_gaps_are_what_numpy_makes_of_them(data: st.DataObject) -> None:
    lengths = data.draw(st.lists(st.integers(1, 5_000), min_size=2, max_size=8))
    parts = [noise(n, 1, seed) + 5 * seed for seed, n in enumerate(lengths)]
    if sum(n for n in lengths if n >= 64) < 1000:
        parts.append(noise(1000, 1, 50))
    octaves = Octaves(1)
    for k, part in enumerate(parts):
        if k:
            octaves.skip(data.draw(st.integers(9, 10**6)))
        octaves.add(part)
    counts = octaves.counts(0)
    assert (counts.knocks, counts.steps, counts.bridged, counts.gaps) == (0, 0, 0, len(parts) - 1)
    check_lines(octaves.periodogram(0, H), lines([part[:, 0] for part in parts]))


@pytest.mark.slow
@settings(deadline=None, max_examples=30)
@given(st.data())
def test_bridged_samples_spoil_level_0_only(data: st.DataObject) -> None:
    n = data.draw(st.integers(4_000, 20_000))
    at = data.draw(st.integers(3_000, n - 100))
    lost = data.draw(st.integers(1, 3))
    y = noise(n, 1, n)
    octaves = Octaves(1)
    octaves.add(y[:at])
    octaves.skip(lost)
    octaves.add(y[at + lost :])
    made_up = np.zeros(n, dtype=bool)
    made_up[at : at + lost] = True
    full = y[:, 0].copy()
    full[made_up] = np.interp(np.flatnonzero(made_up), [at - 1, at + lost], full[[at - 1, at + lost]])
    counts = octaves.counts(0)
    assert (counts.bridged, counts.lost, counts.gaps, counts.used) == (lost, lost, 0, n - lost)
    check_lines(octaves.periodogram(0, H), lines([full], [made_up]))


@settings(deadline=None, max_examples=30)
@given(st.data())
def test_cuts_of_the_rows_change_nothing(data: st.DataObject) -> None:
    memory = data.draw(st.sampled_from([0.0, 300.0, 5000.5]))
    once, cut = Octaves(2, memory), Octaves(2, memory)
    for k in range(data.draw(st.integers(1, 4))):
        y = noise(data.draw(st.integers(1, 6_000)), 2, k)
        y[data.draw(st.integers(0, len(y) - 1)) :] += data.draw(st.sampled_from([0.0, 2.0, 50.0]))
        once.add(y)
        for part in np.split(y, sorted(data.draw(st.lists(st.integers(0, len(y)), max_size=9)))):
            if len(part):
                cut.cells(0, H)  # reading the spectrum (its cells) does not change it
            cut.add(part)
        lost = data.draw(st.integers(0, 12))
        once.skip(lost)
        for _ in range(lost):
            cut.skip(1)
    assert once.save() == cut.save()


@pytest.mark.slow
def test_white_noise_is_flat_across_the_joints() -> None:
    """In the mean of many series of white noise, the spectrum is flat in every octave and across the
    boundaries between octaves.
    """
    n, lanes = 60_000, 300
    octaves = fed(noise(n, lanes, 5))
    found = [octaves.periodogram(lane, H) for lane in range(lanes)]
    lam, weight = found[0].lam, found[0].weight
    power = np.array([p.power for p in found])
    error = 1 / np.sqrt(lanes * weight)
    assert np.abs((power.mean(axis=0) - 1) / error).max() < 4
    joints = np.append(0.3477 * np.pi / 2.0 ** np.arange(5), 0)
    bands = [(lam >= low) & (lam < high) for low, high in zip(joints, [4, *joints[:-1]], strict=True)]
    means = np.array([np.average(power[:, band].mean(axis=0), weights=weight[band]) for band in bands])
    errors = np.array([1 / np.sqrt(lanes * weight[band].sum()) for band in bands])
    assert np.abs((means - 1) / errors).max() < 4
    assert np.abs(np.diff(means) / np.hypot(errors[1:], errors[:-1])).max() < 4
    # The power at each frequency is a mean, and its weight is the number of independent values in this mean.
    # So the mean power of a record has the variance 1 / (sum of the weights), as its expected value is 1. The
    # variance of the mean powers of all these records agrees with that.
    total = (power * weight).sum(axis=1) / weight.sum()
    assert total.var() * weight.sum() == pytest.approx(1, abs=4 * np.sqrt(2 / lanes))
    assert weight.sum() > 0.94 * n / 2


@pytest.mark.slow
@pytest.mark.parametrize(("alpha", "g"), [(0.4, -0.02), (0.8, -0.02), (1.2, -0.01)])
def test_spectrum_of_fractional_noise_is_that_of_theory(alpha: float, g: float) -> None:
    """The running spectrum of a million samples agrees with the theoretical one of a noise of fractional
    order in white noise.

    The variance of the white noise is a third of the variance that drives the state.
    """
    n = 1_000_000
    y = long_recursion(alpha, g, n, 3)[:, np.newaxis] + noise(n, 1, 4) * np.sqrt(1 / 3)
    octaves = fed(y)
    data = binned(octaves.periodogram(0, H))
    theory = spectra.fractional(data.lam, alpha, g) + 1 / 3
    z = (data.power[0] / theory - 1) * np.sqrt(data.counts)
    assert np.abs(z[data.counts > 30]).max() < 4.5
    high = data.lam > 0.01
    assert np.average(data.power[0] / theory, weights=data.counts * high) == pytest.approx(
        1, abs=4 / np.sqrt(data.counts[high].sum())
    )
    counts = octaves.counts(0)
    assert (counts.knocks, counts.steps, counts.changes) == (0, 0, 0)


def test_weights_of_a_periodogram() -> None:
    """An average of weighted ordinates equals the average in which each ordinate is repeated as often as its
    weight says.
    """
    lam = np.repeat(np.linspace(0.1, 3.141, 200), 3)
    power = np.repeat(np.random.default_rng(1).exponential(size=200), 3)
    single = binned(Periodogram(lam, power, H, 4000, np.ones(600)))
    weighted = binned(Periodogram(lam[::3], power[::3], H, 4000, np.full(200, 3.0)))
    for one, other in zip(single, weighted, strict=True):
        assert one == pytest.approx(other)
    p = Periodogram(lam[::3], power[::3], H, 4000, np.arange(200.0)).without(10, [(20, 30)])
    hz = lam[::3] / (2 * np.pi * H)
    keep = (hz >= 10) & ~((hz >= 20) & (hz <= 30))
    assert p.weight is not None
    assert (p.weight == np.flatnonzero(keep)).all()
    assert len(p.lam) == keep.sum()


@pytest.mark.parametrize(
    ("refused", "why"),
    [
        (lambda: fed(np.full((500, 1), 3.25)).periodogram(0, H), "constant"),
        (lambda: fed(noise(100, 1, 1)).periodogram(0, H), "record longer"),
        (lambda: Octaves(1).periodogram(0, H), "record longer"),
        (lambda: fed(noise(1000, 1, 1)).periodogram(0, 0), "sampling period"),
        (lambda: Octaves(0), "lane"),
        *((lambda memory=memory: Octaves(1, memory), "memory") for memory in (-1.0, 10.0, np.nan, np.inf)),
        *((lambda wrong=wrong: fed(np.array([[wrong]])), "y") for wrong in (np.nan, np.inf, 1e101)),
        (lambda: Octaves(2).add(noise(5, 1, 1)), "shape"),
        (lambda: Octaves(2).counts(2), "lane|range|2"),
    ],
)
def test_refuses(refused: Callable[[], object], why: str) -> None:
    with pytest.raises((ValueError, IndexError), match=why):
        refused()


def test_the_allan_sums_take_what_the_gate_accepts() -> None:
    """The Allan sums leave out samples of short motions (knocks). They begin anew there, and after a loss."""
    y = noise(5000, 1, 3)
    y[2000:2100] += 80
    octaves = Octaves(1)
    octaves.add(y[:3000])
    octaves.skip(500)
    octaves.add(y[3000:])
    gate, expected = octaves.counts(0), AllanSums()
    assert gate.knocked == 256
    expected.add(y[:1920, 0])
    expected.cut(256)
    expected.add(y[2176:3000, 0])
    expected.cut(500)
    expected.add(y[3000:, 0])
    found = octaves.allan(0)
    for one, other in zip(found, expected.points(), strict=False):
        assert one == pytest.approx(other)
    assert found.samples == expected.samples == gate.used
    again = Octaves.restore(1, 0.0, octaves.save())
    assert again.allan(0) == found
    again.merge(octaves)
    assert again.allan(0).terms[0] == 2 * found.terms[0]


@pytest.mark.parametrize("drift", ["ramp", "exponential"])
def test_drift_does_not_leak(drift: str) -> None:
    """The samples are white noise with a drift of 20 σ in ten minutes.

    Above 0.02 Hz, where drift ends by definition, only white noise is left.
    """
    n, lanes = 60_000, 8
    t = np.arange(n)[:, np.newaxis] / n
    octaves = fed(noise(n, lanes, 3) + 20 * (t if drift == "ramp" else -np.expm1(-3 * t)))
    spectra = [octaves.periodogram(lane, H) for lane in range(lanes)]
    hz = spectra[0].lam / (2 * np.pi * H)
    power = np.mean([one.power for one in spectra], axis=0)
    for low, high in ((0.02, 0.05), (0.05, 0.2), (0.2, 1.0)):
        band = (hz >= low) & (hz < high)
        error = 1 / np.sqrt(lanes * band.sum())
        assert power[band].mean() == pytest.approx(1, abs=5 * error), (low, high)


def test_what_was_taken_out_is_told() -> None:
    """A cubic is fitted to a record as its drift, and the power of the cubic is reported. For white noise
    without drift, this power is the variance of the noise.

    In a short record, the cubic is subtracted only if it is large: it also has power at fitted frequencies.
    """
    lanes = 40
    y = noise(20_000, lanes, 4)
    octaves = fed(y[:3000])
    short = [octaves.lines_and_drift(lane, H)[1] for lane in range(lanes)]
    assert np.mean([one.power for one in short if one]) == pytest.approx(1, abs=4 * np.sqrt(2 / 3 / lanes))
    octaves.add(y[3000:])
    found = [octaves.lines_and_drift(lane, H)[1] for lane in range(lanes)]
    assert {one.amplitudes for one in found if one} == {3}
    assert np.mean([one.power for one in found if one]) == pytest.approx(1, abs=4 * np.sqrt(2 / 3 / lanes))
    octaves.skip(1000)
    octaves.add(y[:5000] + 3)
    gap = octaves.lines_and_drift(0, H)[1]
    assert (gap.amplitudes, gap.power < 5) == (6, True)
    steep = fed(y[:, :1] + np.linspace(0, 1, 20_000)[:, np.newaxis]).lines_and_drift(0, H)[1]
    assert steep.power == pytest.approx(20_000 / 12 / 3, rel=0.1)
