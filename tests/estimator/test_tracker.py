"""Tests in which the tracker of the bias is compared with a Kalman filter in numpy, for everything that may
happen to a sensor.
"""

import itertools
import math
from functools import cache

import numpy as np
import pytest
from fltea.estimator.tracker import Tracker
from fltea.records.arrays import Array
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.tiers import slow
from tests.rig.tracker_support import SYSTEMS, kalman, lanes, run, simulated, tracker, white

EXACT = 512
"""For this many samples after a start, the tracker computes its Kalman gains at each sample."""
every = pytest.mark.parametrize("name", SYSTEMS)


@every
def test_it_is_the_filter_of_textbooks(name: str) -> None:
    s = SYSTEMS[name]
    y, _ = simulated(s, 4000, 1)
    y[0] = 0  # the first sample is 0, because the tracker subtracts it from all samples
    found, expected = run(tracker(s), y), kalman(s, y)
    for column in ("state", "state_std", "bias", "bias_std", "innovation"):
        own, wanted = getattr(found, column), expected[column]
        np.testing.assert_allclose(own[:EXACT], wanted[:EXACT], rtol=1e-6, atol=1e-6, err_msg=column)
    scale = math.sqrt(expected["S"][-1])
    still = name in ("walk", "quantisation, walk", "relaxation, fixed offset", "walking offset")
    # Later, the tracker computes its gains only once in 256 samples. Its results differ until the gains are
    # steady.
    apart = (1e-3 if still else 0.05) * scale
    np.testing.assert_allclose(found.bias[EXACT:], expected["bias"][EXACT:], atol=apart)
    np.testing.assert_allclose(found.innovation[EXACT:], expected["innovation"][EXACT:], atol=apart)
    np.testing.assert_allclose(found.bias_std[EXACT:], expected["bias_std"][EXACT:], rtol=0.03)
    np.testing.assert_allclose(found.state_std[EXACT:], expected["state_std"][EXACT:], rtol=0.03, atol=1e-9)


@pytest.mark.parametrize("n", [10**3, 10**4, 10**6])
def test_an_offset_in_white_noise_is_known_by_one_over_the_root_of_n(n: int) -> None:
    y = np.random.default_rng(2).standard_normal(n)
    found = run(tracker(white(1.0).with_offset()), y)
    at = np.arange(EXACT, n)
    # Now and then, a possible step of the bias makes σ larger for a short time.
    usual = np.abs(found.bias_std[at] * np.sqrt(at + 1) - 1) < 0.03
    assert usual.mean() > 0.99
    mean = np.cumsum(y)[at] / (at + 1)
    assert np.abs((found.bias[at] - mean) * np.sqrt(at + 1))[usual].max() < 0.5
    np.testing.assert_array_equal(found.state, 0)
    np.testing.assert_array_equal(found.state_std, 0)


def test_the_offset_is_within_what_is_said() -> None:
    y = np.random.default_rng(3).standard_normal((3000, 500)) + 0.7
    one = Tracker([None] * 500)
    for lane in range(500):
        one.set(lane, white(1.0).with_offset())
    found = one.run(y)
    for at in (50, 500, 1000, 2999):
        inside = np.abs(found.bias[at] - 0.7) < 2 * found.bias_std[at]
        assert 0.925 < inside.mean() < 0.98


@cache
def disturbed() -> Array:
    """Return samples of two axes with motion, a spike, and a step of the bias. The second axis is rounded to
    counts of 0.1.
    """
    y = 0.5 + np.random.default_rng(4).standard_normal((4000, 2)) * [1.0, 0.1]
    y[700:900] += 300 * np.sin(np.arange(200) / 9)[:, None]
    y[1500, 0] += 1e4
    y[2000:] += [0, 40]
    y[:, 1] = np.round(y[:, 1], 1)
    return y


def pair(modelled: bool) -> Tracker:
    one = Tracker([None, 0.5])
    if modelled:
        one.set(0, SYSTEMS["low-pass"])
        one.set(1, SYSTEMS["walk"])
    return one


@pytest.mark.parametrize("modelled", [slow(False), True], ids=["bank", "system"])
@given(cuts=st.lists(st.integers(0, 4000), max_size=8), lost=st.integers(0, 3))
def test_cuts_change_no_bit(modelled: bool, cuts: list[int], lost: int) -> None:
    y, whole, cut = disturbed(), pair(modelled), pair(modelled)
    at = sorted({*cuts, 1000, 3000, 4000})
    expected, found = [], []
    for low, high in ((0, 1000), (1000, 3000), (3000, 4000)):
        expected.append(lanes(whole.run(y[low:high])))
        for one in [x for x in at if low < x <= high]:
            found.append(lanes(cut.run(y[low:one])))
            low = one
        whole.skip(lost)
        for _ in range(lost):
            cut.skip(1)
    np.testing.assert_array_equal(np.concatenate(found, 1), np.concatenate(expected, 1))
    assert whole.save() == cut.save()
    assert whole.figures() == cut.figures()


@pytest.mark.parametrize("modelled", [slow(False), True], ids=["bank", "system"])
@given(
    at=st.one_of(
        st.integers(0, 4000), st.integers(690, 960), st.integers(1490, 1600), st.integers(2000, 3100)
    )
)
def test_what_was_saved_goes_on_to_the_bit(modelled: bool, at: int) -> None:
    y, one, other = disturbed(), pair(modelled), pair(False)
    one.run(y[:at])
    other.load(one.save())
    assert other.save() == one.save()
    # a tracker knows its newest bias and the bias's σ only for samples that it has processed itself
    newest = {"bias": None, "bias_std": None}
    assert other.figures() == [figures._replace(**newest) for figures in one.figures()]
    np.testing.assert_array_equal(lanes(other.run(y[at:])), lanes(one.run(y[at:])))
    assert other.save() == one.save()


@settings(max_examples=20)
@given(saved=st.integers(0, 600), gap=st.integers(0, 600))
def test_the_gains_that_all_banks_share_give_the_bits_of_its_own(saved: int, gap: int) -> None:
    """All banks of filters share their Kalman gains as long as they can.

    After a snapshot is loaded, and after each gap, a bank computes its own gains from the covariance, which
    gives the same bits.
    """
    y, one, other = disturbed()[:700], pair(False), pair(False)
    found: list[list[np.ndarray]] = [[], []]
    for low, high in itertools.pairwise(sorted({0, saved, gap, 700})):
        if low == saved:
            bytes_, other = other.save(), pair(False)
            other.load(bytes_)
        for each, into in zip((one, other), found, strict=True):
            if low == gap:
                each.skip(3)
            into.append(lanes(each.run(y[low:high])))
    np.testing.assert_array_equal(np.concatenate(found[0], 1), np.concatenate(found[1], 1))
    assert one.save() == other.save()


@pytest.mark.parametrize("modelled", [False, True], ids=["bank", "system"])
def test_what_a_stranger_saved_changes_nothing(modelled: bool) -> None:
    y, one = disturbed(), pair(modelled)
    one.run(y[:1000])
    before = one.save()
    numbers, rng = np.frombuffer(before), np.random.default_rng(5)
    refused = 0
    for k in range(600):
        hostile = numbers.copy()
        kind, at = k % 6, int(rng.integers(len(numbers) if k % 2 else 200))
        if kind < 4:
            hostile[at] = [math.nan, math.inf, -1e308, 0.5][kind]
        elif kind == 4:
            hostile = hostile[:at]
        else:
            hostile = np.append(hostile, 0.0)
        try:
            one.load(hostile.tobytes())
        except ValueError:
            refused += 1
            assert one.save() == before
        else:
            one.run(y[:300])
            one.load(before)
    assert refused > 300
    for bad in (b"", b"x", before[:-1], before + b"x", np.zeros(len(numbers)).tobytes()):
        with pytest.raises(ValueError, match="cannot be read"):
            one.load(bad)
    assert one.save() == before


@every
@pytest.mark.parametrize("lost", [1, 100])
def test_gaps_are_predicted_over(name: str, lost: int) -> None:
    s = SYSTEMS[name]
    y, _ = simulated(s, 1000 + lost, 6)
    y[0] = 0
    y[400 : 400 + lost] = math.nan
    one, expected = tracker(s), kalman(s, y)
    before = run(one, y[:400])
    one.skip(lost)
    found = run(one, y[400 + lost :][:100])
    seen = slice(400 + lost, 500 + lost)
    np.testing.assert_allclose(found.bias, expected["bias"][seen], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.bias_std, expected["bias_std"][seen], rtol=1e-6)
    assert not found.moving.any()
    assert not before.moving.any()


@pytest.mark.parametrize("modelled", [False, True], ids=["bank", "system"])
def test_a_gap_of_more_than_a_quarter_of_an_hour_is_a_new_beginning(modelled: bool) -> None:
    y = np.random.default_rng(7).standard_normal(2000)
    one, other = (tracker(SYSTEMS["low-pass"] if modelled else None) for _ in range(2))
    run(one, y[:1000])
    one.skip(100_001)
    np.testing.assert_array_equal(lanes(run(one, y[1000:] + 50)), lanes(run(other, y[1000:] + 50)))


def test_lost_samples_must_be_a_number() -> None:
    for count in (-1, 1e16, math.nan):
        with pytest.raises(ValueError, match="lost"):
            Tracker([None]).skip(count)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300])
def test_what_is_no_measurement_changes_nothing(value: float) -> None:
    one = tracker(SYSTEMS["walk"])
    run(one, np.ones(100))
    before = one.save()
    y = np.zeros(10)
    y[7] = value
    with pytest.raises(ValueError, match="y"):
        run(one, y)
    with pytest.raises(ValueError, match="shape"):
        one.run(np.zeros((3, 2)))
    assert one.save() == before


def test_the_bias_is_that_of_x_from_the_origin_on() -> None:
    s = SYSTEMS["low-pass"]
    one = tracker(s)
    found = run(one, simulated(s, 700, 1)[0] + 5)
    origin, x = one.x(0)
    assert origin + s.bias @ x == pytest.approx(found.bias[-1], rel=1e-12)
    assert Tracker([None]).x(0)[1].size == 0
