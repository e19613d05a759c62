"""Tests of records with missing samples: all stretches between the gaps are used, and the result agrees with
that of the complete record.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import Lanes
from fltea.identification import findings
from fltea.identification.allan import allan, overlapping
from fltea.identification.axis import IdentifyOptions
from fltea.identification.data_checks import axis_data_checks
from fltea.identification.gaps import (
    LONGEST_BRIDGE,
    Gaps,
    Stretch,
    _nearest,
    bridged,
    cut,
    longest_epoch,
    no_gaps,
    spread,
)
from fltea.identification.load import Request
from fltea.identification.run import identify_all
from fltea.identification.sums import (
    examined,
    lines_together,
    octaves_of_stretches,
    one_a_depth,
    parts_of,
)
from fltea.identification.workers import Here
from fltea.records.arrays import Array
from fltea.spectrum.noise_figures import noise_figures
from fltea.spectrum.periodogram import Periodogram
from fltea.spectrum.verdict import decide
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tests.rig.identify_files import LSB_PER_DPS, QUICK, RATE_HZ, counts, identify_axis, npz
from tests.rig.identify_files import settings as quick
from tests.rig.identify_support import H, ar, white
from tests.rig.one_fltea import fltea_fit


def lose(y: Array, keep: NDArray[np.bool_]) -> tuple[Array, Gaps]:
    """Return the samples of y to keep, and where samples are missing.

    The first and the last sample are always kept.
    """
    keep[[0, -1]] = True
    places = np.flatnonzero(keep)
    missing = np.diff(places) - 1
    at = np.flatnonzero(missing) + 1
    return y[keep], Gaps(at, missing[at - 1])


def at_random(y: Array, share: float, seed: int = 0) -> tuple[Array, Gaps]:
    """Drop the proportion `share` of the samples, at random."""
    return lose(y, np.random.default_rng(seed).random(len(y)) >= share)


def in_gaps(y: Array, gaps: int, length: int) -> tuple[Array, Gaps]:
    """Drop samples in `gaps` gaps of `length` samples each, which are spread evenly."""
    keep = np.ones(len(y), dtype=bool)
    for begin in np.linspace(length, len(y) - 2 * length, gaps).astype(int):
        keep[begin : begin + length] = False
    return lose(y, keep)


@given(st.lists(st.booleans(), min_size=2, max_size=200), st.integers(0, 12))
@settings(deadline=None)
def test_every_sample_keeps_its_place(kept: list[bool], longest: int) -> None:
    y = np.arange(1.0, len(kept) + 1)
    seen, gaps = lose(y, np.array(kept))
    whole, missing = spread(seen, gaps)
    assert len(whole) == len(y)
    there = np.ones(len(y), dtype=bool) if missing is None else ~missing
    np.testing.assert_array_equal(whole[there], seen)
    np.testing.assert_array_equal(whole[there], y[there])
    assert [gaps.place(k) + 1 for k in range(len(seen))] == seen.tolist()
    parts = cut(len(seen), gaps, longest)
    assert [part[0] for part in parts[1:]] == [part[1] for part in parts[:-1]]
    assert (parts[0][0], parts[-1][1]) == (0, len(seen))
    for begin, end, _ in parts:
        assert (gaps.within(begin, end).missing <= longest).all()


def test_bridges_leave_the_samples_alone() -> None:
    y = np.rint(4 * white(3000, 1, 2)[0])
    (same,) = bridged(y, no_gaps())
    assert same.y is y  # samples of a record without gaps are not even copied
    seen, gaps = at_random(y, 0.02)
    (one,) = bridged(seen, gaps)
    _, missing = spread(seen, gaps)
    np.testing.assert_array_equal(one.y[~missing], seen)
    assert np.isin(one.y[missing], y).all()  # samples that fill gaps are whole counts, too
    seen, gaps = in_gaps(y, 3, LONGEST_BRIDGE + 1)
    assert [len(one.y) for one in bridged(seen, gaps)] == np.diff([0, *gaps.at, len(seen)]).tolist()
    unknown = Gaps(np.array([1000]), np.array([0]))
    assert [len(one.y) for one in bridged(y, unknown)] == [1000, 2000]
    assert longest_epoch(len(y), unknown) == (1000, 3000)


def with_gaps(y: Array, seed: int) -> tuple[Array, float, float, tuple[()], Gaps]:
    """Return the arguments of `examined` for samples y of which 1 % were lost at random."""
    seen, gaps = at_random(y, 0.01, seed)
    return seen, H, 0.0, (), gaps


@pytest.mark.parametrize("phi", [0.0, 0.9, -0.6])
def test_what_is_drawn_is_like_the_rest(phi: float) -> None:
    """The samples that fill a gap have the same variance as the other samples, and the same correlation with
    their neighbours.
    """
    y = ar((phi,), 20_000, 1, 9)[0]
    seen, gaps = in_gaps(y, 300, 5)
    (one,) = bridged(seen, gaps)
    _, missing = spread(seen, gaps)
    assert missing is not None
    drawn = np.flatnonzero(missing)
    assert np.var(one.y[drawn]) == pytest.approx(1 / (1 - phi**2), rel=0.2)
    steps = one.y[drawn] - phi * one.y[drawn - 1]
    assert np.var(steps) == pytest.approx(1.0, rel=0.15)


def slow(n: int, seed: int) -> Array:
    """Return white noise plus a slow relaxation."""
    return np.asarray(ar((0.98,), n, 1, seed)[0] + 5 * white(n, 1, seed + 1)[0])


@pytest.mark.parametrize("coloured", [False, True])
def test_one_percent_lost(coloured: bool) -> None:
    """If 1 % of the samples are lost, verdict and white noise do not change. Straight lines across the gaps
    would tilt the spectrum by 4 %.
    """
    n = 30_000
    y = slow(n, 3) if coloured else white(n, 1, 3)[0]
    seen, gaps = at_random(y, 0.01)
    options = IdentifyOptions(QUICK)
    whole, broken = identify_axis(y, H, None, options), identify_axis(seen, H, None, options, gaps)
    assert broken.samples == broken.fltea.samples == len(seen) > 0.98 * n
    assert broken.verdict.kind == whole.verdict.kind
    N = broken.level.N
    assert N.low < (whole.level.N.value or 0) < N.high
    # Samples lost in the start-up window are not predicted.
    assert 0.9 * len(gaps.at) < broken.fltea.predicted <= n - len(seen)


def test_the_null_test_keeps_its_level() -> None:
    """The null test keeps its level of 5 %: of 40 records of white noise with 1 % of the samples lost, about
    two have a p-value below 5 %, and at most six do.
    """
    found = [examined(*with_gaps(white(6000, 1, seed)[0], seed)).evidence.p_all for seed in range(40)]
    assert sum(p < 0.05 for p in found) <= 6
    assert 0.3 < float(np.median(found)) < 0.7 or max(found) == 1.0


def test_fifty_gaps_of_a_second() -> None:
    y = slow(150_000, 5)
    seen, gaps = in_gaps(y, 50, 100)
    sums = octaves_of_stretches(bridged(seen, gaps)).counts(0)
    assert (sums.used, sums.bridged, sums.gaps) == (len(seen), 0, 50)
    assert sums.used > 0.95 * len(y)
    whole, broken = examined(y, H), examined(seen, H, gaps=gaps)
    assert decide(broken.evidence).kind == decide(whole.evidence).kind
    # Relaxations that are slower than the time between gaps are not found any more. Those faster than a third
    # of that time are found.
    assert len(broken.evidence.candidates.data.lam) > 0.3 * len(whole.evidence.candidates.data.lam)


@given(st.lists(st.sampled_from((300, 301, 2000, 5000)), min_size=1, max_size=4))
def test_stretches_that_became_one_a_depth_give_the_same_spectrum(lengths: list[int]) -> None:
    found = parts_of([Stretch(white(n, 1, k)[0], 0) for k, n in enumerate(lengths)])
    (whole, drift), (few, few_drift) = (lines_together(one, H, 5000) for one in (found, one_a_depth(found)))
    assert (whole.weight is None) == (few.weight is None)
    for one, other in zip(moments(few), moments(whole), strict=True):
        assert one == pytest.approx(other)
    assert few_drift == pytest.approx(drift)


def moments(spectrum: Periodogram) -> tuple[float, ...]:
    weight = np.ones_like(spectrum.lam) if spectrum.weight is None else spectrum.weight
    return float(weight.sum()), float(spectrum.lam @ weight), float(spectrum.power @ weight)


def test_allan_deviation_of_stretches() -> None:
    """The Allan deviation is the average over the stretches between gaps, weighted by their numbers of
    differences.
    """
    parts = [white(n, 1, n)[0] + offset for n, offset in ((400, 3.0), (150, -8.0), (30, 0.0), (1, 5.0))]
    factors = np.array([1, 3, 10, 100])
    found = overlapping(parts, factors)
    for m, value in zip(factors.tolist(), found.tolist(), strict=True):
        squares: list[float] = []
        for y in parts:
            means = np.convolve(y, np.ones(m) / m, "valid")
            squares += ((means[m:] - means[:-m]) ** 2).tolist()
        assert value == pytest.approx(math.sqrt(np.mean(squares) / 2), rel=1e-9)
    (one,) = white(2000, 1, 1)
    both = allan([one, one], H)
    assert both.deviation == pytest.approx(allan([one], H).deviation)
    assert both.degrees_of_freedom[5] == pytest.approx(2 * allan([one], H).degrees_of_freedom[5], rel=0.02)
    with pytest.raises(ValueError, match="99 samples"):
        allan([one[:99], one[:50]], H)


def test_fltea_predicts_and_begins_again() -> None:
    """If three samples are lost, the algorithm FLTEA predicts them and goes on, as in live use.

    After 101 lost samples, it starts over. Its result is that of the longest run between such long gaps.
    """
    y = white(3000, 1, 6)[0]
    keep = np.ones(3000, dtype=bool)
    keep[600:701] = False
    keep[1500:1503] = False
    seen, gaps = lose(y, keep)
    assert longest_epoch(len(seen), gaps) == (600, len(seen))
    found, _ = fltea_fit(seen, H, QUICK, None, gaps)
    assert (found.samples, found.predicted) == (2296, 3)
    lanes = Lanes(1, LaneSettings(QUICK, H, [found.R]))
    missing = ~keep[801:, np.newaxis]
    last = lanes.run(y[801:, np.newaxis] - found.bias, missing)
    assert found.alpha == pytest.approx(float(last.alpha[-1, 0]), rel=1e-9)


def test_nothing_stands_out_across_a_gap() -> None:
    """Across a gap, slow noise changes by much more than from one sample to the next.

    This change is no outlier. A knock elsewhere is still found, at its time.
    """
    y = np.cumsum(white(4000, 1, 7)[0]) / 30 + white(4000, 1, 8)[0] / 1000
    y[2000:] += 20
    seen, gaps = y, Gaps(np.array([2000]), np.array([0]))
    assert "outliers" in [data_check.kind for data_check in axis_data_checks(y, H)]
    assert "outliers" not in [data_check.kind for data_check in axis_data_checks(seen, H, gaps=gaps)]
    y[3000] += 5
    late = Gaps(np.array([2000]), np.array([1000]))
    (data_check,) = (
        data_check for data_check in axis_data_checks(y, H, gaps=late) if data_check.kind == "outliers"
    )
    assert "the first at 40 s" in data_check.text


def test_a_recording_with_losses(tmp_path: Path) -> None:
    """This test goes the whole way from a file to figures, with shuffled copies and curves.

    1 % of the samples are lost at random, and there are two long gaps.
    """
    raw = counts(3000, 1)
    keep = np.random.default_rng(1).random(3000) >= 0.01
    keep[700:1000] = keep[2400:2450] = False
    keep[0] = True
    places = np.flatnonzero(keep)
    path = npz(tmp_path / "a.npz", raw[keep], time_s=places / RATE_HZ, seq=places)
    (report,) = identify_all([Request((path,))], quick(figures=True), Here())
    c = report.recording.counts
    assert c.used == c.samples == len(places)
    assert c.lost - c.bridged == 350
    axis = report.axes["gyro_x"]
    assert axis.result.verdict.kind == "white"
    fit = axis.result.fltea
    assert fit.samples + fit.predicted < 2000 < axis.result.samples
    assert axis.result.longest_stretch > 1300
    assert f"over the longest part, {fit.samples:,} of 2,6" in findings.settings(axis)
    assert axis.allan.N.value == pytest.approx(16 / LSB_PER_DPS * math.sqrt(H), rel=0.05)
    assert all(axis.reproduction.within)
    assert axis.curves.path.t_s[-1] == pytest.approx((fit.samples + fit.predicted) * H)


AS_BEFORE = {
    "mpu6050_sunsided_10min": (
        (1.238e-09, 0.012581855775373045),
        (1.0, 0.009145931267988763),
        (0.6829, 0.009662383167484962),
    ),
    "mpu6050_tomisuarez_100s": (
        (0.1764, 0.007442243800687661),
        (1.0, 0.011149496294971419),
        (0.5687, 0.009387381033015063),
    ),
}
"""For each recording and axis: the p-value of the fitted part of the periodogram, and N, as an earlier
version computed them.

That version used only one of the stretches between gaps. These recordings have no gaps, so the results have
to agree. The p-values differ a little, since the values of the periodogram now have a smaller weight.
"""


@pytest.mark.parametrize("name", AS_BEFORE)
def test_unbroken_recordings_are_what_they_were(name: str, recordings: Path) -> None:
    with np.load(recordings / f"{name}.npz") as d:
        y, h = d["gyro_raw"] / float(d["lsb_per_dps"]), 1 / float(d["fs_hz"])
    for axis, (p, N) in enumerate(AS_BEFORE[name]):
        seen = examined(y[:, axis], h, gaps=no_gaps())
        assert seen.evidence.p_clean == pytest.approx(p, rel=0.05)
        level = noise_figures(seen.evidence, decide(seen.evidence)).level
        assert level.N.value == pytest.approx(N, rel=1e-4)


def test_what_is_drawn_becomes_the_nearest_of_the_values() -> None:
    found = _nearest(np.array([0.0, 1.0, 3.0]), np.array([-1.0, 0.4, 0.6, 1.9, 2.1, 5.0]))
    assert found.tolist() == [0.0, 0.0, 1.0, 1.0, 3.0, 3.0]
