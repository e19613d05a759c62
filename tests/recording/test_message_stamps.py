"""Tests what the stamps of messages show: which samples are missing, and the sampling rate."""

import numpy as np
import pytest
from fltea.recording.message_stamps import Times, is_uneven, judge
from hypothesis import given, settings
from hypothesis import strategies as st

N = 3000
PERIOD_NS = 5_000_000


def kept(seed: int, share: float, longest: int = 1) -> Times:
    """Of N samples, return the numbers of those that remain.

    A loss begins at each sample with the probability `share`, and takes up to `longest` samples.
    """
    rng = np.random.default_rng(seed)
    lost = rng.random(N) < share
    for begin in np.flatnonzero(lost):
        lost[begin : begin + rng.integers(1, longest + 1)] = True
    lost[[0, -1]] = False
    return np.flatnonzero(~lost)


@given(
    seed=st.integers(0, 2**32),
    share=st.sampled_from([0.0, 0.002, 0.01, 0.05]),
    longest=st.sampled_from([1, 3, 700]),
    jitter=st.sampled_from([0.0, 0.02, 0.05]),
    period_ns=st.sampled_from([125_000.0, 4_999_321.7, 10_000_000.0, 100_000_000.0]),
)
@settings(max_examples=150)
def test_samples_are_numbered_as_the_sensor_took_them(
    seed: int, share: float, longest: int, jitter: float, period_ns: float
) -> None:
    number = kept(seed, share if longest < 700 else share / 50, longest)
    rng = np.random.default_rng(seed)
    stamps = np.rint(number * period_ns + rng.normal(0, jitter, len(number)) * period_ns).astype(np.int64)
    found = judge(stamps, None)
    np.testing.assert_array_equal(found.sequence(0, len(number)), number)
    assert found.period_ns == pytest.approx(period_ns, rel=3e-4 if jitter else 1e-6)
    assert not len(found.epoch_row)


@given(seed=st.integers(0, 2**32), batch=st.integers(2, 40))
@settings(max_examples=10)
def test_samples_that_are_stamped_when_a_batch_is_read(seed: int, batch: int) -> None:
    """The driver reads a FIFO, so several samples have the same stamp, or almost the same."""
    rng = np.random.default_rng(seed)
    number = np.arange(N)
    stamps = (number // batch + 1) * batch * PERIOD_NS + (number % batch) * int(rng.integers(0, 3)) * 10_000
    found = judge(stamps, None)
    assert found.period_ns == pytest.approx(PERIOD_NS, rel=2 * batch / N)
    assert not len(found.gap_row)
    assert is_uneven(found, N)
    stamps[1500:] += 300 * PERIOD_NS
    assert judge(stamps, None).missing.sum() == pytest.approx(300, abs=batch)


def test_late_stamps_are_no_gap() -> None:
    stamps = np.arange(N) * PERIOD_NS
    late = stamps.copy()
    # from each of these samples on, the computer was busy: 20 messages waited, and were then stamped together
    for begin in (100, 700, 1500):
        late[begin : begin + 20] = np.maximum(late[begin : begin + 20], stamps[begin + 20] - 20_000)
    found = judge(late, None)
    assert not len(found.gap_row)
    assert found.period_ns == pytest.approx(PERIOD_NS, rel=1e-6)
    assert not is_uneven(found, N)
    assert found.uneven > 30


def test_a_gap_between_late_stamps() -> None:
    rng = np.random.default_rng(3)
    number = np.setdiff1d(np.arange(N), np.arange(1000, 1007))
    stamps = number * PERIOD_NS + np.rint(rng.exponential(1.5e6, len(number))).astype(np.int64)
    found = judge(stamps, None)
    assert found.gap_row.tolist() == [1000]
    assert found.missing.tolist() == [7]


def test_late_stamps_just_before_and_after_a_gap() -> None:
    number = np.setdiff1d(np.arange(N), np.arange(1000, 1007))
    stamps = number * PERIOD_NS
    # the stamps of the last three samples before the gap are late: by 0.4, 0.8 and 1.2 periods
    stamps[997:1000] += np.array([4, 8, 12]) * PERIOD_NS // 10
    assert judge(stamps, None).missing.tolist() == [7]
    stamps[1000:1003] += np.array([19, 14, 9]) * PERIOD_NS // 10
    assert judge(stamps, None).missing.tolist() == [7]
    # now the last stamp before the gap is so late that some of the 7 samples may have been lost before it, so
    # only the total is checked
    stamps[999] += 3 * PERIOD_NS
    assert judge(stamps, None).missing.sum() == 7


def test_stamps_of_milliseconds_are_no_jitter_that_matters() -> None:
    stamps = np.rint(np.arange(N) * 1e9 / 150 / 1e6).astype(np.int64) * 1_000_000
    found = judge(stamps, None)
    assert 1e9 / found.period_ns == pytest.approx(150, rel=1e-4)
    assert not len(found.gap_row)


def test_a_jump_that_the_arrivals_know_nothing_of_is_of_the_clock() -> None:
    arrivals = 10**18 + np.arange(N) * PERIOD_NS
    stamps = arrivals.copy()
    stamps[:1] = 0
    stamps[2000:] += 3_600_000_000_000
    found = judge(stamps, arrivals)
    assert found.epoch_row.tolist() == [1, 2000]
    assert not len(found.gap_row)
    assert found.period_ns == pytest.approx(PERIOD_NS, rel=1e-9)
    with_the_computer_off = judge(stamps[1:], stamps[1:])
    assert with_the_computer_off.missing.tolist() == [720_000]


def test_stamps_that_do_not_advance() -> None:
    for stamps in (np.zeros(50, np.int64), np.arange(50)[::-1] * PERIOD_NS):
        with pytest.raises(ValueError, match="do not advance"):
            judge(stamps, None)


@given(stamps=st.lists(st.integers(-(2**61), 2**61), min_size=2, max_size=80))
@settings(max_examples=100)
def test_any_stamps(stamps: list[int]) -> None:
    times = np.array(stamps, np.int64)
    try:
        found = judge(times, times[::-1].copy())
    except ValueError:
        return
    number = found.sequence(0, len(times))
    assert (np.diff(number) >= 1).all()
    assert found.period_ns > 0


@given(
    seed=st.integers(0, 2**32),
    behind_ns=st.sampled_from([0, 2_000]),
    jitter_ns=st.sampled_from([0, 100_000]),
    lost=st.sampled_from([0, 5]),
)
@settings(max_examples=20)
def test_a_stamp_that_repeats_the_one_before_is_no_lost_sample(
    seed: int, behind_ns: int, jitter_ns: int, lost: int
) -> None:
    """The driver reads the sensor's time before a new time is available, so the sample gets the stamp of the
    sample before.
    """
    rng = np.random.default_rng(seed)
    n = 24_000
    number = np.arange(n) + lost * (np.arange(n) >= 12_000)
    stamps = number * PERIOD_NS + np.rint(rng.normal(0, jitter_ns, n)).astype(np.int64)
    # stamps near the gap stay as they are: beside a gap, an old stamp could also be another lost sample
    places = np.setdiff1d(np.arange(2, n - 2, 3), np.arange(11_990, 12_010))
    again = rng.choice(places, 48, replace=False)
    stamps[again] = stamps[again - 1] + behind_ns
    found = judge(stamps, None)
    assert found.missing.sum() == lost
    np.testing.assert_array_equal(found.sequence(0, n), number)
    assert found.period_ns == pytest.approx(PERIOD_NS, rel=1e-6 if not jitter_ns else 1e-4)
