"""The running test of whiteness: its figures by another route, false alarms, power, gaps, snapshots."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from fltea.estimator.running_null import (
    CHUNK,
    EFFECTIVE,
    RunningNull,
    Standing,
    p_value,
)
from fltea.records.null_p import FEWEST, LEVEL, p_text
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from numpy_null import FACTOR, LAGS
from numpy_null import RunningNull as NumpyNull

Array = NDArray[np.float64]


def fed(y: Array, *, test: RunningNull | None = None) -> RunningNull:
    """A test that has taken the rows of y one by one; a row of NaN is a lost sample."""
    test = test or RunningNull(y.shape[1])
    for row in y.tolist():
        if math.isnan(row[0]):
            test.skip(1)
        else:
            test.add(tuple(row))
    return test


def many(y: Array) -> RunningNull:
    """The same by whole chunks, for many series at once."""
    test = RunningNull(y.shape[1])
    test.add_rows(y[: len(y) // CHUNK * CHUNK])
    return test


def rejected(test: RunningNull, level: float) -> float:
    return float(np.mean([s.p is not None and s.p < level for s in test.standings]))


def by_definition(y: Array) -> float:
    """The statistic of one series, from pairs one by one; as many levels and values as the test has taken."""
    largest = 0.0
    blocks, size = y, 1
    while True:
        blocks = blocks[: len(blocks) // CHUNK * CHUNK]
        if not len(blocks):
            return largest
        first = blocks[:CHUNK]
        v = blocks - first[~np.isnan(first)].mean()
        whole = v[~np.isnan(v)]
        mean, of_mean = whole.mean(), whole.var() / len(whole)
        products, squares = [], []
        for lag in range(1, LAGS + 1):
            pairs = [(a, b) for a, b in zip(v[:-lag], v[lag:], strict=True) if not math.isnan(a * b)]
            products.append(sum((a - mean) * (b - mean) + of_mean for a, b in pairs))
            squares.append(sum((a * b) ** 2 for a, b in pairs))
        for weights in (*np.eye(LAGS), *(np.maximum(q - np.arange(1, LAGS + 1), 0) for q in (4, 8))):
            figure = weights @ products / math.sqrt(weights**2 @ squares)
            largest = max(largest, abs(figure))
        size *= FACTOR
        blocks = blocks.reshape(-1, FACTOR).sum(axis=1)


def white(n: int, axes: int, seed: int = 1) -> Array:
    return np.random.default_rng(seed).standard_normal((n, axes))


def test_statistic_is_the_one_that_is_described() -> None:
    y = white(2_200, 2) * [1.0, 30.0] + [5.0, -100.0]
    y[700:703] = y[1500:1511] = np.nan
    test = fed(y)
    expected = [by_definition(y[:, axis]) for axis in range(2)]
    assert test.largest() == pytest.approx(expected, rel=1e-9)
    assert test.depth == 3
    shown = [float(f"{p_value(one, EFFECTIVE * 3):.3g}") for one in expected]
    assert [s.p for s in test.standings] == pytest.approx(shown)


def test_nothing_is_said_of_too_few_samples() -> None:
    test = fed(white(FEWEST // CHUNK * CHUNK, 1))
    assert test.standings == (Standing(None, None),)
    fed(white(CHUNK, 1), test=test)
    assert test.standings[0].whiteness == "not rejected"


def test_lost_samples_are_none_of_the_few() -> None:
    y = white(2_000, 1)
    y[::2] = np.nan
    assert fed(y).standings[0].whiteness is None


@pytest.mark.parametrize("value", [3.7, 1 / 131])
def test_constant_axis_has_no_standing_and_the_others_have(value: float) -> None:
    """Also where some of the first chunk are lost: the mean of 125 times 1/131 is not 1/131."""
    y = white(1_200, 2)
    y[:, 0] = value
    y[:3] = np.nan
    constant, alive = fed(y).standings
    assert constant == (None, None)
    assert alive.whiteness == "not rejected"


def test_an_axis_whose_blocks_never_change_is_judged_by_its_samples() -> None:
    y = np.tile([[0.0], [1.0]], (600, 1))
    assert fed(y).standings[0].whiteness == "rejected"


MAKES: dict[str, Callable[[np.random.Generator, tuple[int, int]], Array]] = {
    "Gaussian": lambda rng, shape: rng.standard_normal(shape),
    "one LSB per deviation": lambda rng, shape: np.rint(rng.standard_normal(shape) + 0.3),
    "t4 tails": lambda rng, shape: rng.standard_t(4, shape),
    "variance that changes": lambda rng, shape: (
        rng.standard_normal(shape) * (1 + 2 * (np.arange(shape[0]) % 700 < 150))[:, np.newaxis]
    ),
}


@pytest.mark.parametrize("kind", MAKES)
def test_false_alarms_are_as_many_as_promised(kind: str) -> None:
    """1,000 series of 30 s: 5 % have a deviation of 0.7 %; and hardly any is called not white."""
    test = many(MAKES[kind](np.random.default_rng(3), (3_000, 1_000)))
    assert 0.035 < rejected(test, 0.05) < 0.065
    assert np.mean([s.whiteness == "rejected" for s in test.standings]) < 0.005


@pytest.mark.parametrize("kind", ["a fifth of an LSB per deviation", "off zero", "rare jumps"])
def test_an_axis_that_hardly_ever_changes_is_not_called_not_white(kind: str) -> None:
    """Nearly all products of two samples are 0: by their own squares alone, half would be rejected."""
    rng = np.random.default_rng(8)
    normal = rng.standard_normal((3_000, 500))
    y = {
        "a fifth of an LSB per deviation": np.rint(0.2 * normal),
        "off zero": np.rint(0.2 * normal + 0.1),
        "rare jumps": (np.abs(normal) > 2.6).astype(float),
    }[kind]
    test = many(y)
    assert rejected(test, 0.05) < 0.08
    assert np.mean([s.whiteness == "rejected" for s in test.standings]) < 0.01


def resonance(n: int, series: int) -> Array:
    """White noise with a third of its power around 31.4 Hz, at 100 Hz."""
    rng = np.random.default_rng(4)
    x, radius, angle = np.zeros((n, series)), 0.9, 2 * np.pi * 0.314
    drive = rng.standard_normal((n, series))
    for k in range(2, n):
        x[k] = 2 * radius * math.cos(angle) * x[k - 1] - radius**2 * x[k - 2] + drive[k]
    return x / x.std() / math.sqrt(2) + rng.standard_normal((n, series))


def fractional(n: int, series: int) -> Array:
    """(1 - B)^-0.3 of white noise, with two thirds of the power white."""
    k = np.arange(1, 2 * n)
    response = np.concatenate(([1.0], np.cumprod((k - 0.7) / k)))
    drive = np.fft.rfft(np.random.default_rng(5).standard_normal((2 * n, series)), 4 * n, axis=0)
    x = np.fft.irfft(drive * np.fft.rfft(response, 4 * n)[:, np.newaxis], axis=0)[n : 2 * n]
    return x / x.std() + math.sqrt(2) * white(n, series, 6)


@pytest.mark.parametrize(
    "y",
    [
        pytest.param(resonance(3_000, 40), id="resonance"),
        pytest.param(fractional(3_000, 40), id="fractional"),
        pytest.param(white(3_000, 40) + np.linspace(0, 2, 3_000)[:, np.newaxis], id="drift"),
        pytest.param(white(3_000, 40)[:-1] - 0.3 * white(3_000, 40)[1:], id="moving average"),
        pytest.param(np.repeat(white(600, 40), 5, axis=0), id="repeated samples"),
    ],
)
def test_power(y: Array) -> None:
    assert np.mean([s.whiteness == "rejected" for s in many(y).standings]) > 0.95


def test_white_noise_that_is_looked_at_for_ten_minutes_is_rarely_called_not_white() -> None:
    """1.6 % of many (here at most 4.5 % of 200); without the strict level it would be nearly half of them."""
    rng = np.random.default_rng(7)
    test = RunningNull(200)
    ever = np.zeros(200, dtype=bool)
    often = np.zeros(200, dtype=bool)
    for _ in range(60_000 // CHUNK):
        test.add_rows(rng.standard_normal((CHUNK, 200)))
        p = np.array([1.0 if s.p is None else s.p for s in test.standings])
        ever |= p < LEVEL
        often |= p < 0.05
    assert ever.mean() < 0.045
    assert often.mean() > 0.3


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e3), st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_offset_and_scale_change_nothing(offset: float, scale: float, seed: int) -> None:
    y = white(1_200, 1, seed)
    assert many(offset + scale * y).largest() == pytest.approx(many(y).largest(), rel=1e-6)


@given(st.integers(0, 2_600), st.integers(0, 2_500), st.integers(0, 300))
@settings(max_examples=25, deadline=None)
def test_restored_anywhere_it_goes_on_as_if_nothing_had_been(cut: int, lost: int, count: int) -> None:
    y = white(2_600, 2)
    y[lost : lost + count] = np.nan
    unbroken = fed(y)
    before = fed(y[:cut])
    restored = RunningNull.restore(2, before.save())
    assert restored.standings == before.standings
    assert restored.save() == before.save()
    after = fed(y[cut:], test=restored)
    assert after.standings == unbroken.standings
    assert after.save() == unbroken.save()


def damaged(place: int, value: float) -> bytes:
    """A saved test with another number at `place`: 0 is how many samples wait, 1 how many were taken."""
    numbers = np.frombuffer(fed(white(300, 2)).save(), "<f8").copy()
    numbers[place] = value
    return numbers.tobytes()


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"abc",
        white(3, 3).tobytes(),
        fed(white(300, 2)).save()[:-8],
        *(damaged(place, value) for place in (0, 1) for value in (math.inf, math.nan, -1.0)),
        damaged(0, 1e15),
    ],
)
def test_what_is_no_saved_test_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="running test"):
        RunningNull.restore(2, data)


@given(st.integers(1, 40), st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_no_pair_reaches_across_a_gap(missing: int, seed: int) -> None:
    y = white(1_280, 1, seed)
    with_gap = np.concatenate((y[:600], np.full((missing, 1), np.nan), y[600:]))
    n = len(with_gap) // CHUNK * CHUNK
    assert fed(with_gap).largest() == pytest.approx(by_definition(with_gap[:n, 0]), rel=1e-9)


def test_p_value_and_its_text() -> None:
    assert p_value(0.0, 8) == 1.0
    assert p_value(1.959964, 1) == pytest.approx(0.05, rel=1e-5)
    assert p_value(20.0, 24) == pytest.approx(24 * math.erfc(20 / math.sqrt(2)), rel=1e-6)
    assert p_value(60.0, 24) == 0.0
    assert [p_text(p) for p in (0.99, 0.31, 0.0123, 0.001, 1e-12)] == [
        "p = 0.99",
        "p = 0.31",
        "p = 0.012",
        "p = 0.001",
        "p < 0.001",
    ]


@given(
    n=st.integers(0, 9_000), lost=st.integers(0, 9_000), count=st.integers(0, 700), seed=st.integers(0, 99)
)
@settings(max_examples=25)
def test_equals_the_numpy_oracle_and_either_goes_on_where_the_other_stopped(
    n: int, lost: int, count: int, seed: int
) -> None:
    y = white(n + 1_500, 3, seed)
    y[: lost // 2, 1] = y[0, 1]
    y[lost : lost + count] = np.nan
    native, oracle = fed(y[:n]), fed(y[:n], test=NumpyNull(3))
    found, expected = (np.frombuffer(test.save(), "<f8") for test in (native, oracle))
    assert len(found) == len(expected)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(native.largest(), oracle.largest(), rtol=1e-7, atol=1e-7)
    assert native.depth == oracle.depth
    swapped = fed(y[n:], test=RunningNull.restore(3, oracle.save()))
    for a, b in zip(swapped.standings, fed(y).standings, strict=True):
        assert a.whiteness == b.whiteness
        assert a.p == (b.p if b.p is None else pytest.approx(b.p, rel=1.1e-2))
    NumpyNull.restore(3, native.save())


@pytest.mark.parametrize("y", [1e90 * white(3_000, 2), 1e-160 * white(3_000, 2), np.ones((3_000, 2))])
def test_nothing_is_said_of_what_overflows_or_vanishes(y: Array) -> None:
    assert all(one.whiteness != "rejected" for one in fed(y).standings)
