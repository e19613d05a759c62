"""The state of the octave spectrum: snapshots, sums of two spectra, and fading of old samples.

The tests include the power of each frequency band over time.
"""

import numpy as np
import pytest
from fltea.spectrum.octaves import WHOLE, Octaves
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.identify_support import H
from tests.rig.numpy_octaves import check_lines, fed, lines, noise


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 30_000), st.integers(1, 10_000), st.sampled_from([0.0, 400.0, 3000.0]))
def test_a_snapshot_goes_on_as_if_nothing_had_happened(before: int, after: int, memory: float) -> None:
    octaves = Octaves(2, memory)
    y = noise(before + after, 2, 1)
    octaves.add(y[:before])
    octaves.skip(3)
    saved, copied = octaves.save(), octaves.copy()
    restored = Octaves.restore(2, memory, saved)
    assert saved == restored.save()
    for one in (octaves, restored):
        one.add(y[before:])
    assert octaves.save() == restored.save()
    assert copied.save() == saved
    if after + before > 1000:
        p, q = octaves.periodogram(1, H), restored.periodogram(1, H)
        assert (p.power == q.power).all()
        assert (p.weight == q.weight).all()


@settings(deadline=None, max_examples=100)
@given(st.data())
def test_hostile_snapshots_are_refused_or_harmless(data: st.DataObject) -> None:
    octaves = Octaves(1, data.draw(st.sampled_from([0.0, 1000.0])))
    octaves.add(noise(data.draw(st.sampled_from([100, 2_000, 9_000])), 1, 1))
    numbers = np.frombuffer(octaves.save()).copy()
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, 120) | st.integers(0, len(numbers) - 1))
        numbers[at % len(numbers)] = data.draw(st.floats() | st.integers(-2, 5000).map(float))
    whole = numbers.tobytes()
    bytes_ = data.draw(st.sampled_from([whole, whole[:-8], whole[:-3], whole + bytes(8), b""]))
    try:
        restored = Octaves.restore(1, 0.0, bytes_)
    except ValueError:
        return
    restored.add(noise(7_000, 1, 2))
    restored.cells(0, H)
    try:
        restored.periodogram(0, H)
    except ValueError:
        return


def test_snapshots_of_others_are_refused() -> None:
    data = fed(noise(5_000, 2, 1)).save()
    for lanes in (1, 3):
        with pytest.raises(ValueError, match="cannot be read"):
            Octaves.restore(lanes, 0.0, data)
    with pytest.raises(ValueError, match="cannot be read"):
        Octaves.restore(2, 0.0, data[: len(data) // 2])


@pytest.mark.slow
@settings(deadline=None, max_examples=30)
@given(st.lists(st.integers(1, 20_000), min_size=2, max_size=4), st.integers(0, 99))
def test_sums_of_two_are_those_of_both(lengths: list[int], seed: int) -> None:
    """The sum of two records' spectra is the spectrum of both records. The test includes the sum of a record
    with itself, and samples that are added after the sum.
    """
    lengths[0] += 1000
    parts = [noise(n, 1, seed + k) + k for k, n in enumerate(lengths)]
    total = fed(parts[0])
    for part in parts[1:]:
        total.merge(fed(part))
    assert total.samples == total.counts(0).used == sum(lengths)
    check_lines(total.periodogram(0, H), lines([part[:, 0] for part in parts]))
    total.merge(total)
    total.add(parts[0])
    check_lines(total.periodogram(0, H), lines([part[:, 0] for part in (*parts, *parts, parts[0])]))


def test_a_merge_needs_the_same_lanes_and_memory() -> None:
    for other in (Octaves(2), Octaves(1, 1000.0)):
        with pytest.raises(ValueError, match="another number of lanes"):
            Octaves(1).merge(other)


@pytest.mark.parametrize("memory", [500.0, 2_000.0, 20_000.0])
def test_nothing_of_the_old_level_is_left(memory: float) -> None:
    """With a limited memory, the spectrum does not depend on an earlier level of the noise after three times
    the length of the memory.

    The spectra after two different levels are equal to the last bit. This is so already after twice the
    length of the memory.
    """
    n = int(10 * memory)
    old, new = noise(n, 1, 1), noise(int(3 * memory), 1, 2)
    spectra = []
    for factor in (1.0, 2.0):
        octaves = Octaves(1, memory)
        octaves.add(old * factor)
        octaves.skip(100)
        before = octaves.periodogram(0, H)
        assert np.average(before.power, weights=before.weight) == pytest.approx(
            factor**2, rel=6 / np.sqrt(memory)
        )
        octaves.add(new)
        spectra.append(octaves.periodogram(0, H))
    assert (spectra[0].lam == spectra[1].lam).all()
    assert (spectra[0].power == spectra[1].power).all()
    assert np.average(spectra[0].power, weights=spectra[0].weight) == pytest.approx(
        1, rel=6 / np.sqrt(memory)
    )


def test_time_without_samples_is_forgotten_too() -> None:
    octaves = Octaves(1, 2_000.0)
    octaves.add(noise(20_000, 1, 1))
    octaves.skip(5_000)
    with pytest.raises(ValueError, match="record longer"):
        octaves.periodogram(0, H)


def test_weights_say_how_much_is_remembered() -> None:
    """While old samples fade, the mean power always has the variance 1 / (sum of the spectrum's weights)."""
    lanes, memory = 200, 5_000.0
    octaves = Octaves(lanes, memory)
    octaves.add(noise(20_000, lanes, 3))
    for seed in range(4, 8):
        octaves.add(noise(1_250, lanes, seed))
        means, total = [], 0.0
        for lane in range(lanes):
            p = octaves.periodogram(lane, H)
            total = float(p.weight.sum())
            means.append(np.average(p.power, weights=p.weight))
        assert 0.9 * memory / 2 < total < 2.1 * memory / 2
        assert np.var(means) * total == pytest.approx(1, abs=5 * np.sqrt(2 / lanes))


@pytest.mark.parametrize("n", [2_000, 50_000, 300_000])
def test_cells_say_when_the_power_changed(n: int) -> None:
    y = noise(n, 1, 1)
    y[n // 2 :] *= 2
    bands = fed(y).cells(0, H)
    top = bands[0]
    assert (top.low_hz, top.high_hz) == pytest.approx((44.5 / 2.56, 127.5 / 2.56))
    assert [band.high_hz for band in bands[1:]] == pytest.approx(
        [89.5 / 2.56 / 2**k for k in range(1, len(bands))]
    )
    assert top.counts.sum() == (n - 128) // 128
    assert len(top.counts) <= 16
    assert (np.diff(top.first) > 0).all()
    early = top.first + 256 + 128 * top.counts < n / 2
    late = top.first >= n / 2
    assert top.mean_log[late].mean() - top.mean_log[early].mean() == pytest.approx(np.log(4), abs=0.1)
    assert top.mean_log[early].mean() == pytest.approx(0, abs=0.1)
    if n >= 50_000:
        within = top.variance_log[early | late]
        assert within == pytest.approx(np.full(len(within), 2 / 83), rel=1)


def test_cells_of_a_merge_and_of_a_memory() -> None:
    total = fed(noise(40_000, 1, 1))
    total.merge(fed(3 * noise(100_000, 1, 2)))
    top = total.cells(0, H)[0]
    assert len(top.counts) <= 16
    assert top.first[-1] > 100_000
    assert top.mean_log[-1] - top.mean_log[0] == pytest.approx(np.log(9), abs=0.1)
    forgetful = Octaves(1, 10_000.0)
    forgetful.add(noise(200_000, 1, 1))
    top = forgetful.cells(0, H)[0]
    assert top.first[0] > 200_000 - 3 * 10_000
    assert len(top.counts) <= 16
    assert top.counts.sum() * 128 > WHOLE
