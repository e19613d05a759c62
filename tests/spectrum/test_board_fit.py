"""The board's spectrum and fit, compared with the host's for the same samples.

The board computes the periodogram of the whole record for up to 496 samples, the host for up to 3,072. Beyond
this, both use octaves: each has half the sampling rate of the octave before. The board's filters for the
octaves start later, so the board's spectrum has a few percent fewer samples at the lowest frequencies. So the
fits are close, not equal. tests/native checks that the arithmetic is the same.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from fltea.spectrum.candidate_models import CandidateModels, native, order_in_white
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.order_fit import OrderFit, order_fit
from fltea.spectrum.periodogram import Periodogram, binned
from numpy.typing import NDArray

from tests.rig.identify_support import H
from tests.rig.spectrum_probe import BoardFit, BoardSpectrum, board_quantile
from tools.validation.device import SIGMA, agreement, drawn

WHITE, FRACTIONAL = 1, 2
NOISES = (
    *((0.6, -0.05, 0.3), (0.8, -0.005, 0.05), (0.4, -0.1, 0.5), (0.7, -0.03, 0.1), (0.5, -0.005, 0.2)),
    *((0.9, -0.01, 0.01),),
)
"""Parameters of the noises: the order α, g = h^α f (h: sampling period), and s2 / (s2 + R). Here s2 is the
variance that drives the state, and R that of the white noise.
"""


def on_board(counts: NDArray[np.int16], gaps: dict[int, int]) -> BoardFit:
    board, begin = BoardSpectrum(), 0
    for at, lost in gaps.items():
        board.add(counts[begin:at])
        board.skip(lost)
        begin = at
    board.add(counts[begin:])
    return board.fit()


def on_host(counts: NDArray[np.int16], gaps: dict[int, int]) -> Octaves:
    host, begin = Octaves(1), 0
    for at, lost in gaps.items():
        host.add(counts[begin:at, np.newaxis].astype(np.float64))
        host.skip(lost)
        begin = at
    host.add(counts[begin:, np.newaxis].astype(np.float64))
    return host


def order_of(whole: Periodogram, h: float) -> OrderFit:
    """Return the host's fit of the model that the board fits: white noise plus noise of an order α of up to
    2.
    """
    f = CandidateModels(binned(whole), h, 0)
    return order_fit(f, order_in_white(f.native))


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("gaps", [{}, {7000: 3, 20001: 400, 45017: 12}])
def test_the_order_and_its_interval_are_near_the_hosts(
    noise: tuple[float, float, float], gaps: dict[int, int]
) -> None:
    counts = drawn(60_000, *noise, np.random.default_rng(NOISES.index(noise)))
    board = on_board(counts, gaps)
    whole = on_host(counts, gaps).periodogram(0, H)
    host = order_of(whole, H)
    alpha = host.alpha
    assert board.alpha_defined
    half = (alpha.high - alpha.low) / 2
    assert abs(board.alpha - alpha.value) < (0.8 if gaps else 0.4) * half
    assert 0.8 < 1.96 * board.alpha_std / half < 1.3
    assert board.verdict != WHITE
    # After each gap in the samples, the filters of all octaves restart. The octaves of the lowest frequencies
    # lose the most samples.
    ratio = board.ratio_white / ratio_of_order(whole)
    assert (0.65 if gaps else 0.9) < ratio < 1.02
    assert board.ordinates == pytest.approx(whole.ordinates, rel=0.05)
    assert board.R / host.R.value == pytest.approx(1, abs=0.25 if gaps else 0.1)


@pytest.mark.long
def test_of_a_million_samples_it_says_what_the_host_says() -> None:
    """For a million samples, the board's verdicts are the host's. The test uses all twenty noises of `make
    validate ARGS=device`, whose figures are in firmware/README.md.
    """
    cases = agreement(1_000_000, 2)
    assert len(cases) == 20
    assert all(one["same_verdict"] for one in cases)
    apart = [one["half_widths"] for one in cases]
    assert float(np.median(apart)) < 0.1
    assert max(apart) < 0.3


WEAK_ORDER = 0.35
"""Order of a weak noise at 100 Hz with f = -1, driving noise of variance Q = 0.004 and white noise of
variance R = 0.02. Orders of 0.1 to 0.7 fit nearly equally well, and the likelihood often has two maxima.
"""


def weak_noise(seed: int) -> NDArray[np.int16]:
    rng = np.random.default_rng(seed)
    return drawn(120_000, WEAK_ORDER, -(0.01**WEAK_ORDER), 0.004 / 0.024, rng)[:60_000]


def holds_weak_order(found: BoardFit) -> bool:
    return abs(found.alpha - WEAK_ORDER) <= 1.96 * found.alpha_std


def test_of_weak_noise_the_interval_knows_more_than_the_curvature() -> None:
    """The board's intervals of an order contain the true order in at least 18 of these 20 records. Intervals
    from the curvature of the likelihood alone would contain it in only 8.
    """
    found = [on_board(weak_noise(seed), {}) for seed in range(20)]
    assert all(one.alpha_defined for one in found)
    assert sum(map(holds_weak_order, found)) >= 18


def fits_as_it_grows(counts: NDArray[np.int16]) -> list[BoardFit]:
    """Return every fit of a growing record; each fit has 300 more samples than the fit before."""
    board = BoardSpectrum()
    board.add(counts[:900])
    fits = []
    for begin in range(900, len(counts), 300):
        board.add(counts[begin : begin + 300])
        fits.append(board.fit())
    return fits


@pytest.mark.slow
def test_of_weak_noise_the_interval_holds_the_order_and_the_next_answer() -> None:
    """The board's last interval of an order contains the true order in most of 40 records. While a record
    grows, at most one fitted order in 300 is outside the interval of the previous fit.

    Intervals from the curvature of the likelihood alone contained the true order in only 20 records, and 65
    of 7,234 fitted orders were outside the previous interval.
    """
    records = [fits_as_it_grows(weak_noise(seed)) for seed in range(40)]
    defined = [fits[-1] for fits in records if fits[-1].alpha_defined]
    assert len(defined) >= 36
    assert sum(map(holds_weak_order, defined)) >= 0.85 * len(defined)
    steps = [(a, b) for fits in records for a, b in pairwise(fits) if a.alpha_defined and b.alpha_defined]
    left = sum(abs(b.alpha - a.alpha) > 1.96 * a.alpha_std for a, b in steps)
    assert left <= len(steps) / 300


def ratio_of_order(whole: Periodogram) -> float:
    """Return the host's likelihood ratio of noise of a fractional order to white noise.

    A board tests no other alternative to white noise.
    """
    return native(binned(whole), whole.h, whole.n).null_test([])[0]


def test_white_noise_is_hardly_ever_called_anything_else() -> None:
    """The board tests white noise at the level 5 %, so 3 of 60 records are expected to be rejected.

    Up to 8 are accepted. These are five more than expected, which is three standard deviations of a binomial.
    """
    rng = np.random.default_rng(4)
    found = [on_board(np.rint(SIGMA * rng.standard_normal(6000)).astype(np.int16), {}) for _ in range(60)]
    assert sum(one.verdict != WHITE for one in found) <= 8
    for one in found:
        rejected = one.ratio_white > board_quantile(0, one.ordinates) + 1e-3
        assert rejected == (one.verdict != WHITE)


@pytest.mark.parametrize("name", ["mpu6050_sunsided_10min.npz", "mpu6050_tomisuarez_100s.npz"])
@pytest.mark.parametrize("axis", range(3))
def test_on_real_sensors_white_noise_is_judged_as_the_host_does(
    recordings: Path, name: str, axis: int
) -> None:
    data = np.load(recordings / name)
    counts, h = data["gyro_raw"][:, axis].astype(np.int16), 1 / float(data["fs_hz"])
    board = on_board(counts, {})
    whole = on_host(counts, {}).periodogram(0, h)
    white = ratio_of_order(whole) <= board_quantile(0, whole.ordinates)
    assert (board.verdict == WHITE) == white
    if not white:
        alpha = order_of(whole, h).alpha
        assert board.alpha_defined == (alpha.value is not None)
        if alpha.value is not None and alpha.low is not None and alpha.high is not None:
            assert abs(board.alpha - alpha.value) < 0.1 * (alpha.high - alpha.low) / 2
