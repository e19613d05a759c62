"""Running sums of the Allan variance agree with allantools, however samples are divided, merged or saved."""

import allantools
import numpy as np
import pytest
from fltea._native import AllanSums
from fltea.spectrum.allan_dof import full_overlap
from hypothesis import given, settings
from hypothesis import strategies as st

FULL = 8
"""Longest averaging time, in samples, for which a pair of means begins at every sample (full overlap)."""


def sums_of(y, memory=0.0):
    sums = AllanSums(memory)
    sums.add(y)
    return sums


def series(kind, n, seed=1):
    white = np.random.default_rng(seed).standard_normal(n)
    return np.cumsum(white) / 10 if kind == "random walk" else white + 5


@pytest.mark.parametrize("kind", ["white", "random walk"])
@pytest.mark.parametrize("n", [300, 5000, 200_003])
def test_against_allantools(kind, n):
    y = series(kind, n)
    factors, avar, terms = (np.array(one) for one in sums_of(y).points())
    assert factors.tolist() == [2.0**j for j in range(len(factors))]
    assert 2 * factors[-1] <= n < 4 * factors[-1]
    some = factors <= n / 3
    factors, adev, terms = factors[some], np.sqrt(avar)[some], terms[some]
    _, expected, _, theirs = allantools.oadev(y, rate=1, data_type="freq", taus=factors)
    whole = factors <= FULL
    np.testing.assert_allclose(adev[whole], expected[whole], rtol=1e-12)
    np.testing.assert_array_equal(terms[whole], theirs[whole])
    # For averaging times τ that are longer than FULL, only eight pairs of means begin within each τ. So the
    # two deviations differ, but by less than 0.7 of their standard error.
    error = expected / np.sqrt(2 * full_overlap(-2 if kind == "random walk" else 0, factors, n))
    assert (np.abs(adev - expected) < 0.7 * error).all()


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 90), st.booleans()), max_size=40), st.sampled_from([0.0, 40.0, 1000.0])
)
def test_cuts_of_the_rows_looks_and_snapshots_change_nothing(parts, memory):
    """It does not matter how samples are divided, whether sums are read in between, or saved and restored.

    `parts`: for each call, the number of samples, and whether a break follows them.
    """
    rng = np.random.default_rng(len(parts))
    rows = [rng.standard_normal(n) for n, _ in parts]
    one, other = AllanSums(memory), AllanSums(memory)
    waiting = []
    for y, (_, ends) in zip(rows, parts, strict=True):
        one.add(y)
        one.points()
        restored = AllanSums(memory)
        restored.load(one.save())
        one = restored
        waiting.append(y)
        if ends:
            other.add(np.concatenate(waiting))
            waiting = []
            one.cut(3)
            other.cut(3)
    if waiting:
        other.add(np.concatenate(waiting))
    assert one.save() == other.save()
    assert one.points() == other.points()
    assert one.samples == sum(n for n, _ in parts)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(0, 3000), min_size=1, max_size=5), st.sampled_from([0.0, 500.0]))
def test_merged_sums_are_those_of_both(lengths, memory):
    rng = np.random.default_rng(sum(lengths))
    merged = AllanSums(memory)
    squares: dict[float, float] = {}
    for n in lengths:
        part = sums_of(rng.standard_normal(n), memory)
        merged.merge(part)
        for m, avar, terms in zip(*part.points(), strict=True):
            squares[m] = squares.get(m, 0.0) + avar * terms
    assert merged.samples == sum(lengths)
    factors, avar, terms = merged.points()
    assert factors == sorted(squares)
    if memory == 0:
        assert [a * n for a, n in zip(avar, terms, strict=True)] == pytest.approx(
            [squares[m] for m in factors], rel=1e-12
        )


def test_weights_fall_with_the_memory():
    """Each term of the sum has the weight exp(-age / memory) relative to the newest term."""
    y, memory = series("white", 4000), 150.0
    factors, avar, terms = sums_of(y, memory).points()
    assert 2 * factors[-1] <= 3 * memory < 4 * factors[-1]
    for j, m in enumerate(int(one) for one in factors):
        step = max(m // 8, 1)
        sums = np.add.reduceat(y, np.arange(0, len(y), step))[: len(y) // step]
        blocks = np.convolve(sums, np.ones(m // step), "valid")
        apart = blocks[m // step :] - blocks[: -(m // step)]
        weight = np.exp(-step / memory * np.arange(len(apart))[::-1])
        assert avar[j] == pytest.approx(np.average(apart**2, weights=weight) / (2 * m * m), rel=1e-9)
        assert terms[j] == pytest.approx(weight.sum() ** 2 / (weight**2).sum(), rel=1e-9)


@pytest.mark.parametrize("number", [np.nan, np.inf, 1.01e100])
def test_numbers_that_are_refused(number):
    sums = sums_of(series("white", 100))
    before = sums.save()
    with pytest.raises(ValueError, match="y"):
        sums.add(np.array([1.0, number]))
    assert sums.save() == before


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_a_snapshot_that_cannot_be_one(data):
    """A damaged snapshot is either refused, or the sums can continue from it."""
    good = np.frombuffer(sums_of(series("white", data.draw(st.integers(0, 700)))).save())
    bad = good.copy()
    at = data.draw(st.integers(0, len(bad) - 1))
    bad[at] = data.draw(st.floats(allow_nan=True, allow_infinity=True))
    sums = AllanSums()
    try:
        sums.load(bad.tobytes())
    except ValueError:
        assert sums.save() == AllanSums().save()
        return
    sums.add(series("white", 500))
    assert np.isfinite(sums.points()[1]).all()


@pytest.mark.parametrize("cut", [slice(0, 0), slice(0, -1), slice(0, -8), slice(8, None)])
def test_snapshots_of_another_length(cut):
    good = sums_of(series("white", 1000)).save()
    with pytest.raises(ValueError, match="cannot be read"):
        AllanSums().load(good[cut])
