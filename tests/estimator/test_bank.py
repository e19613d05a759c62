"""Tests of the bank of filters (the filters of a sensor's axes). It is compared with a plain Python oracle,
and with itself when the samples are divided into other blocks.

The oracle processes one sample at a time.
"""

from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.estimator.bank import Bank
from fltea.estimator.baseline import Baseline
from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import butter, lfilter

from tests.rig.bank_support import AXES, COLUMNS, Gaps, H, assert_close, assert_same, by_bank, by_sample

LSB = 1 / 16.4


def config(**more: object) -> EstimatorConfig:
    return EstimatorConfig(**({"startup": 100, "window": 200} | more))  # type: ignore[arg-type]


PRINTED = {"variant": "triple", "guard": "off"}
SETTINGS = [
    {},
    PRINTED,
    {"variant": "triple", "guard": "faithful"},
    {"memory": "direct", "window": 30},
    {"window": 0},
    {"bias": [0.5, -1.0, 2.0], "R": [0.02, 0.03, 0.04]},
    {"bias": "none", "R": 0.02},
    {"bias": 0.5},
    {"R": 0.02},
]


def noise(n: int, axes: int = 3, seed: int = 0, quantised: bool = True) -> Array:
    y = np.random.default_rng(seed).standard_normal((n, axes)) * 0.153 + np.array([0.5, -1.0, 2.0])[:axes]
    return np.rint(y / LSB) * LSB if quantised else y


@pytest.mark.parametrize("changes", SETTINGS, ids=str)
@pytest.mark.parametrize("lsb", [LSB, None])
def test_equals_the_oracle_on_noise(changes: dict[str, object], lsb: float | None) -> None:
    y = noise(1500, quantised=lsb is not None)
    assert_close(by_bank(y, config(**changes), lsb, cuts=[700]), by_sample(y, config(**changes), lsb))


@pytest.mark.parametrize("changes", [{}, PRINTED], ids=str)
def test_equals_the_oracle_with_gaps(changes: dict[str, object]) -> None:
    gaps = {30: 5, 99: 1, 100: 2, 400: 1, 401: 60, 900: 300}
    y = noise(1300)
    assert_close(by_bank(y, config(**changes), LSB, gaps), by_sample(y, config(**changes), LSB, gaps))


def test_equals_the_oracle_with_runaways_and_tells_each() -> None:
    y = noise(2500)
    y[:, 1] += 1.0  # an offset that the settings do not remove
    changes = PRINTED | {"bias": [0.5, -1.0, 2.0], "R": [0.0235, 0.0235, 0.002]}
    found, expected = (f(y, config(**changes), LSB, {1200: 40}) for f in (by_bank, by_sample))
    assert sum(expected.restarts.values()) > 3
    assert expected.lost
    # the tolerance is wide because a run that diverges amplifies any rounding
    assert_close(found, expected, 1e-6)


def test_equals_the_oracle_where_the_guard_has_to_hold() -> None:
    """While the guard has to limit more than a quarter of an axis's last samples to keep its filter within
    bounds, the axis's estimate is invalid. Later the filter restarts.
    """
    y = noise(2000)
    y[600:1100, 0] += 30 * np.random.default_rng(1).choice([-1, 1], 500)
    found = by_bank(y, config(), LSB)
    assert_close(found, by_sample(y, config(), LSB))
    assert found.restarts == {"gyro_x": 1, "gyro_y": 0, "gyro_z": 0}
    assert [(one.lane, one.reason) for one in found.lost] == [(0, "bound")]


@pytest.mark.parametrize("constant", [[1], [0, 2], [0, 1, 2]])
def test_axes_that_never_change_stay_invalid(constant: list[int]) -> None:
    y = noise(1200)
    y[:400, constant] = 0.25
    found = by_bank(y, config(), LSB)
    assert found.constant == tuple(AXES[i] for i in constant)
    assert not found.columns["valid"][:, constant].any()
    assert np.isnan(found.columns["alpha_std"][:, constant]).all()
    assert_close(found, by_sample(y, config(), LSB))


@pytest.mark.parametrize("name", ["mpu6050_sunsided_10min", "mpu6050_tomisuarez_100s"])
def test_equals_the_oracle_on_real_recordings(name: str, recordings: Path) -> None:
    file = np.load(recordings / f"{name}.npz")
    lsb = 1 / float(file["lsb_per_dps"])
    y, gaps = file["gyro_raw"][:6000] * lsb, {2000: 7}
    assert_close(by_bank(y, EstimatorConfig(), lsb, gaps, [3000]), by_sample(y, EstimatorConfig(), lsb, gaps))


@settings(max_examples=60)
@given(
    cuts=st.lists(st.integers(1, 999), max_size=12),
    gaps=st.dictionaries(st.integers(1, 999), st.integers(1, 300), max_size=4),
    changes=st.sampled_from([{}, PRINTED | {"R": 0.002}, {"memory": "direct", "window": 30}]),
    constant=st.booleans(),
)
@example(cuts=list(range(1000)), gaps={}, changes={}, constant=False)
def test_any_cut_of_the_rows_gives_the_same_to_the_bit(
    cuts: list[int], gaps: Gaps, changes: dict[str, object], constant: bool
) -> None:
    y = noise(1000)
    y[200:400, 0] *= 40
    if constant:
        y[:, 2] = 1.0
    whole = by_bank(y, config(**changes), LSB, gaps)
    assert_same(by_bank(y, config(**changes), LSB, gaps, cuts), whole)


def test_each_row_tells_whether_the_innovations_are_white_however_rows_are_cut() -> None:
    """After every hundred innovations, a test decides whether they are white. Each row has the latest
    decision, however the rows are divided into blocks.

    The first axis has noise after a low-pass, the second white noise, and the third noise that is coloured
    for a while.
    """
    y = noise(4000, quantised=False)
    y[:, 0] = lfilter(*butter(2, 20.0, fs=1 / H), y[:, 0])
    y[1500:2100, 2] = lfilter(*butter(2, 20.0, fs=1 / H), y[1500:2100, 2])
    accepted = config(startup=100, variant="triple", guard="faithful", R=0.02)
    one, many = Bank(AXES, accepted, H, None), Bank(AXES, accepted, H, None)
    one.run(y[:100]), many.run(y[:100])
    whole, parts, asked = one.run(y[100:]).white, [], []
    for begin in range(100, 4000, 50):
        block = many.run(y[begin : begin + 50])
        assert block.white is not None
        parts.append(block.white)
        asked.append([bool(white) for white in many.is_white.values()])
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    np.testing.assert_array_equal(whole[99::100], asked[1::2])
    assert not whole[:199].any()
    assert whole[-1].tolist() == [False, True, True]
    assert not whole[1999, 2]


def test_the_start_up_window_takes_no_more_than_it_needs() -> None:
    bank, y = Bank(AXES, config(), H, LSB), noise(300)
    assert bank.startup_remaining == 100
    assert bank.save() is None
    with pytest.raises(ValueError, match="101 samples, but the start-up window takes 100 more"):
        bank.run(y[:101])
    bank.run(y[:40])
    assert bank.baseline is None
    assert (bank.startup_remaining, bank.restarts["gyro_x"], bank.interventions["gyro_x"]) == (60, 0, {})
    last = bank.run(y[40:100])
    assert np.isnan(last.alpha).all()
    assert not last.valid.any()
    np.testing.assert_allclose(bank.baseline.bias_dps, y[:100].mean(axis=0), rtol=1e-14)
    np.testing.assert_allclose(bank.baseline.R, y[:100].var(axis=0, ddof=1), rtol=1e-13)
    assert bank.run(y[100:101]).valid.all()


CLIMBING = [[1.0, 10.0], [2.0, 10.0], [3.0, 16.0]]
BASELINES: list[tuple[Any, Any, float | None, list[list[float]], Baseline]] = [
    # By hand: the first axis has the mean 2 and the variance (1 + 0 + 1)/2, the second has the mean 12 and
    # the variance (4 + 4 + 16)/2.
    ("startup", "auto", None, CLIMBING, Baseline((2, 12), (1, 12), ())),
    ([0.5, -1], [0.02, 0.03], None, [], Baseline((0.5, -1), (0.02, 0.03), ())),
    ("none", 0.02, None, [], Baseline((0, 0), (0.02, 0.02), ())),
    (0.5, 0.02, None, [], Baseline((0.5, 0.5), (0.02, 0.02), ())),
    ([0.5, -1], "auto", None, [[1, 1], [3, 2]], Baseline((0.5, -1), (2, 0.5), ())),
    # a constant axis (the first) is accepted if the settings give its variance R of the white noise
    ("startup", 0.1, None, [[1, 1], [1, 2]], Baseline((1, 1.5), (0.1, 0.1), ())),
    # The resolution of 0.6 limits R from below, to 0.6² / 12. This matters for the first axis, which hardly
    # ever changes, but not for the second, which always does.
    (
        "startup",
        "auto",
        0.6,
        [[0.6 * (k == 0), 0.6 * (k % 2)] for k in range(100)],
        Baseline((0.006, 0.3), (0.03, 1 / 11), ()),
    ),
    ("startup", "auto", 0.6, [[0.6, 0], [0.6, 0.6], [0.6, 1.2]], Baseline((0.6, 0.6), (nan, 0.36), ("x",))),
    # The first axis is constant, although its computed variance is not zero: the computed mean of many values
    # 0.1 is not exactly 0.1.
    (
        "startup",
        "auto",
        None,
        [[0.1, k % 2] for k in range(1000)],
        Baseline((0.1, 0.5), (nan, 250 / 999), ("x",)),
    ),
]


@pytest.mark.parametrize(("bias", "R", "resolution", "window", "expected"), BASELINES)
def test_bias_and_r_by_hand(
    bias: Any, R: Any, resolution: float | None, window: list[list[float]], expected: Baseline
) -> None:
    settings = EstimatorConfig(startup=max(2, len(window)), bias=bias, R=R)
    bank = Bank(("x", "y"), settings, H, resolution)
    assert bank.startup_remaining == len(window)
    if window:
        bank.run(window)
    assert bank.baseline.bias_dps == pytest.approx(expected.bias_dps)
    assert pytest.approx(expected.R, nan_ok=True) == bank.baseline.R
    assert bank.baseline.constant_axes == expected.constant_axes


def test_what_cannot_be_a_sample_is_refused_and_changes_nothing() -> None:
    one, other = (Bank(AXES, config(), H, LSB) for _ in range(2))
    y = noise(300)
    for k in range(0, 300, 100):
        for wrong in (np.nan, np.inf, -1e100):
            bad = y[k : k + 100].copy()
            bad[50, 1] = wrong
            with pytest.raises(ValueError, match=r"y\[50\], lane 1"):
                one.run(bad)
        a, b = one.run(y[k : k + 100]), other.run(y[k : k + 100])
        for name in COLUMNS:
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    for shape in ((3,), (2, 2), (1, 1, 3)):
        with pytest.raises(ValueError, match="y must have the axes gyro_x, gyro_y, gyro_z"):
            one.run(np.zeros(shape))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bias": [1.0]}, "bias needs one value, or 3"),
        ({"bias": 1e308}, "bias must be .* 5e\\+99 deg/s"),
        ({"R": [0.1, 0.2]}, "R needs one value"),
        ({"R": 1e-200, "bias": 0.0}, "R must be "),
    ],
)
def test_settings_that_no_bank_can_work_with(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Bank(AXES, config(**changes), H, LSB)
    with pytest.raises(ValueError, match="the resolution is the size of one count"):
        Bank(AXES, config(), H, 0.0)


def test_samples_that_vary_beyond_measure_or_below_it() -> None:
    y = noise(100, quantised=False)
    bank = Bank(AXES, config(), H, None)
    bank.run(1e-120 * y)
    assert bank.baseline.constant_axes == AXES
    with pytest.raises(ValueError, match=r"R must be"):
        Bank(AXES, config(), H, None).run(1e60 * y)


def test_losses_while_bridging_are_told() -> None:
    """If the filter of an axis diverges while it predicts across a gap, that is reported, too.

    Without the guard, which keeps filters within bounds, the prediction across a long gap can diverge.
    """
    bank, lost = Bank(AXES, config(bias="none", R=1e-3, **PRINTED), H, None), []
    y = noise(400, quantised=False)
    for k in range(0, 400, 20):
        bank.run(y[k : k + 20])
        lost += bank.on_missing(3000)
    assert lost
    assert {one.reason for one in lost} == {"runaway"}
    assert all(0 <= one.row < 3000 for one in lost)
    assert sum(bank.restarts.values()) >= len(lost)


def test_a_gap_without_end_is_refused_and_not_bridged() -> None:
    bank = Bank(AXES, config(), H, LSB)
    bank.run(noise(bank.startup_remaining))
    for count in (2**31, 2**63):
        with pytest.raises(ValueError, match="lost samples can be skipped"):
            bank.on_missing(count)
