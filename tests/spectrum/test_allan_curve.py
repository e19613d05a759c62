"""The live Allan curve: its intervals contain the true value, and N, B and K agree with `identify`.

N, B and K are null if they are not known.
"""

import math
import subprocess
import sys

import allantools
import numpy as np
import pytest
from fltea._native import AllanSums
from fltea.identification.allan import allan
from fltea.noise.parts import Order
from fltea.sources.synthetic import NoiseGenerator, NoiseSettings
from fltea.spectrum.allan_curve import fit_allan, live_allan
from fltea.spectrum.allan_dof import degrees_of_freedom, full_overlap
from fltea.spectrum.candidate_models import CandidateModels, FittedModel
from fltea.spectrum.periodogram import binned, periodogram

from tests.rig.identify_support import H, white

N_LONG = 60_000


def sums_of(y, memory=0.0):
    sums = AllanSums(memory)
    sums.add(np.ascontiguousarray(y))
    return sums


def curve(y, h=H, memory=0.0, unit="deg/s"):
    sums = sums_of(y, memory)
    return live_allan(*sums.points(), sums.span, h, unit)


def walk(K, n, seed):
    return K * np.sqrt(H) * np.cumsum(np.random.default_rng(seed).standard_normal(n))


@pytest.mark.parametrize("power", [0, -1, -2])
@pytest.mark.parametrize("n", [100, 3000, 100_000])
def test_degrees_of_freedom_are_greenhalls(power, n):
    factors = [m for m in (1, 2, 3, 8, 30, 33, 64, 1000, n // 10, n // 4, n // 3) if 3 * m <= n]
    expected = [allantools.edf_greenhall(alpha=power, d=2, m=m, N=n + 1, overlapping=True) for m in factors]
    assert full_overlap(power, factors, n) == pytest.approx(expected, rel=0.012)


@pytest.mark.parametrize("terms", [1, 1.5, 2, 9, 1000])
def test_degrees_of_freedom_of_few_terms(terms):
    for power in (0, -1, -2):
        for m in (1, 2, 8, 32, 64, 2.0**30):
            assert 1 <= degrees_of_freedom(power, [m], [terms])[0] <= max(terms, 1)


@pytest.mark.parametrize("memory", [0.0, 400.0])
def test_intervals_hold_the_truth_of_white_noise(memory):
    """At every averaging time τ, 95 % of the intervals contain the true Allan deviation.

    For 300 series, four standard deviations of the proportion of such intervals are 5 %.
    """
    inside = []
    for y in white(2000, 300, 2):
        found = curve(y, memory=memory)
        truth = np.sqrt(H / np.array(found.tau_s))
        inside.append((found.low < truth) & (truth < found.high))
    share = np.mean(inside, axis=0)
    assert np.abs(share - 0.95).max() < 0.07
    assert share.mean() == pytest.approx(0.95, abs=0.02)


def test_from_one_sample_to_a_third_of_the_record():
    found = curve(white(3000, 1, 1)[0])
    assert found.tau_s[0] == H
    assert 10.0 / 2 < found.tau_s[-1] <= 10.0
    assert found.tau_s == tuple(2**j * H for j in range(len(found.tau_s)))
    assert (np.array(found.low) < found.deviation).all()
    assert (np.array(found.deviation) < found.high).all()
    assert (np.diff(found.degrees_of_freedom) < 0).all()


KINDS = {
    "white": lambda: white(N_LONG, 1, 1)[0] + 4.5,
    "walk": lambda: walk(0.02, N_LONG, 1),
    "both": lambda: white(N_LONG, 1, 1)[0] + walk(0.1, N_LONG, 2),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_identify_reads_is_read_live(kind):
    y = KINDS[kind]()
    live, file = curve(y), allan([y], H)
    pairs = [
        (live.N, file.N, 0.05),
        (live.B, file.B, 0.2),
        (live.K, file.K, 0.2),
    ]
    for mine, theirs, error in pairs:
        assert (mine.value is None) == (theirs.value is None)
        assert bool(mine.reason) == bool(theirs.reason)
        if mine.value is not None:
            assert mine.value == pytest.approx(theirs.value, rel=error)
            assert mine.low < mine.value < mine.high
    assert {"white": live.N, "walk": live.K, "both": live.B}[kind].value is not None


def test_another_unit():
    found = curve(white(3000, 1, 1)[0], unit="g")
    assert found.B.reason.split("at most ")[1].split(":")[0].endswith(" g")


def test_too_short_to_read_anything():
    found = curve(white(100, 1, 1)[0])
    assert len(found.tau_s) == 6
    assert all(one.value is None and one.reason for one in (found.B, found.K))


@pytest.mark.parametrize(
    ("y", "h", "word"),
    [
        (np.ones(1000), H, "constant"),
        (np.arange(99.0), H, "99 samples: .* needs 100"),
        (np.arange(1000.0), 0.0, "h is a sampling period"),
        (np.empty(0), H, "0 samples"),
    ],
)
def test_what_cannot_be_analysed(y, h, word):
    with pytest.raises(ValueError, match=word):
        curve(y, h)


def test_breaks_everywhere():
    sums = AllanSums()
    for _ in range(200):
        sums.add(np.ones(1))
        sums.cut()
    with pytest.raises(ValueError, match="break"):
        live_allan(*sums.points(), sums.span, H)


def test_needs_neither_scipy_nor_allantools():
    script = (
        "import sys; import fltea.spectrum.allan_curve, fltea.noise.allan_deviation;"
        "import fltea.identification.allan;"
        "print([name for name in ('scipy', 'allantools') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# --- the record `fit` ---

WHITE = FittedModel((0,), (0.0,), 0.0)


def fitted(y, noise, N):
    sums = sums_of(y)
    return fit_allan(
        sums.points(), sums.span, H, "deg/s", CandidateModels(binned(periodogram(y, H)), H, len(y)), noise, N
    )


def test_the_curve_of_the_true_model_goes_through_its_intervals():
    settings = NoiseSettings(alpha=0.8, f=-1.0, Q=95.09, R=0.02, lsb_per_dps=0.0)
    noise = NoiseGenerator(settings)
    y = np.array([noise.step()[0] for _ in range(12_000)])
    order = Order(0.8, -1.0, settings.Q)
    noise_parts = FittedModel((0, order.code), (math.log(settings.R), *order.eta(H)), 0.0)
    found = fitted(y, noise_parts, 0.003)
    assert found.tau_s[0] == H
    low, model, high = (np.array(one) for one in (found.low, found.model, found.high))
    assert ((low < model) & (model < high)).mean() > 0.7
    assert np.abs(np.log(model / found.adev))[:6].max() < 0.1
    assert found.N == 0.003


def test_white_noise_and_its_model():
    found = fitted(white(20_000, 1, 1)[0], WHITE, 0.1)
    assert found.N == 0.1
    assert found.model == pytest.approx(np.sqrt(H / np.array(found.tau_s)), rel=1e-6)
    assert found.B is None
    assert found.K is None


@pytest.mark.parametrize("y", [np.empty(0), np.ones(99), np.ones(5000)])
def test_nothing_where_there_is_no_curve(y):
    sums = sums_of(y)
    candidates = CandidateModels(binned(periodogram(white(3000, 1, 1)[0], H)), H, 3000)
    assert fit_allan(sums.points(), sums.span, H, "deg/s", candidates, WHITE, 0.1) is None
