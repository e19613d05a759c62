"""Tests of long records, which are processed in pieces or with fewer samples.

The results have to be those of the full computation.
"""

import numpy as np
import pytest
from fltea.identification import shuffled
from fltea.identification.load import Request, load
from fltea.identification.workers import Processes
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum import periodogram as spectrum
from fltea.spectrum.innovation_whiteness import InnovationSums, innovations
from fltea.spectrum.periodogram import periodogram
from fltea.spectrum.spectral_lines import find_peaks
from hypothesis import given
from hypothesis import strategies as st

H = 0.01


@pytest.mark.parametrize("n", [8 * 700, 8 * 701 + 5, 8 * 1013 + 7])
def test_a_transform_in_parts_is_the_whole_one(monkeypatch, n):
    y = np.random.default_rng(n).standard_normal(n) + 3
    short = y[: n - n % 8]
    whole = periodogram(short, H, from_hz=1.0, notch=[(10, 12)])
    monkeypatch.setattr(spectrum, "LONG", 1000)
    monkeypatch.setattr(spectrum, "PARTS", 8)
    monkeypatch.setattr(spectrum, "AT_ONCE", 333)
    parts = periodogram(y, H, from_hz=1.0, notch=[(10, 12)])
    assert parts.n == len(short)
    np.testing.assert_allclose(parts.lam, whole.lam, rtol=1e-12)
    np.testing.assert_allclose(parts.power, whole.power, rtol=1e-9, atol=1e-12)


def test_ordinates_left_out_later_are_those_left_out_at_once():
    y = np.random.default_rng(3).standard_normal(5000)
    at_once = periodogram(y, H, from_hz=0.02, notch=[(10, 12), (30, 31.5)])
    later = periodogram(y, H).without(0.02, [(10, 12), (30, 31.5)])
    np.testing.assert_array_equal(at_once.lam, later.lam)
    np.testing.assert_array_equal(at_once.power, later.power)
    with pytest.raises(ValueError, match="are needed"):
        later.without(49.9, [])


def test_peaks_are_found_in_whatever_block_they_stand(monkeypatch):
    t = np.arange(20_000) * H
    y = np.random.default_rng(1).standard_normal(len(t)) + 0.5 * np.sin(2 * np.pi * 13.37 * t)
    expected = find_peaks(periodogram(y, H))
    assert expected
    for block in (100, 1000, 3777):
        monkeypatch.setattr("fltea.spectrum.ordinate_peak.AT_ONCE", block)
        assert find_peaks(periodogram(y, H)) == expected


@given(st.lists(st.integers(1, 200), min_size=1, max_size=12))
def test_innovations_in_blocks(cuts):
    rng = np.random.default_rng(sum(cuts))
    n = sum(cuts)
    e, std = rng.standard_normal(n), rng.uniform(0.5, 2, n)
    e[rng.random(n) < 0.05] = np.nan
    sums, begin = InnovationSums(), 0
    for count in cuts:
        sums.add(e[begin : begin + count], std[begin : begin + count])
        begin += count
    found, whole = sums.result(), innovations(e, std)
    assert (found is None) == (whole is None)
    if found is not None:
        assert found.lag1 == pytest.approx(whole.lag1, abs=1e-12)
        assert found.ljung_box == pytest.approx(whole.ljung_box, rel=1e-9)
        assert found.nis == pytest.approx(whole.nis, rel=1e-12)


@pytest.mark.parametrize("variant", ["joint", "triple"])
def test_copies_of_a_long_record_do_not_depend_on_their_group(monkeypatch, variant):
    y = np.random.default_rng(2).standard_normal(6000)
    config = EstimatorConfig(variant=variant)
    monkeypatch.setattr(shuffled, "LONGEST", 2000)
    monkeypatch.setattr(shuffled, "DRAWN", 700)
    all_of_them = shuffled.estimate(y, H, config, None, range(8), 1)
    some = shuffled.estimate(y, H, config, None, range(4, 8), 1)
    np.testing.assert_array_equal(all_of_them.alpha[4:], some.alpha)
    assert np.ptp(some.alpha) > 0
    monkeypatch.setattr(shuffled, "LONGEST", 4000)
    longer = shuffled.estimate(y, H, config, None, range(4, 8), 1)
    # `LONGEST` limits the samples of a copy only for the variant "joint"; "triple" uses as many as the record
    # has
    assert np.array_equal(longer.alpha, some.alpha) == (variant == "triple")


def test_samples_in_files_reach_other_processes(tmp_path):
    gyro = np.random.default_rng(6).integers(-50, 50, (3000, 2))
    np.savez(tmp_path / "rest.npz", gyro_raw=gyro, lsb_per_dps=10.0, fs_hz=100.0)
    folder = tmp_path / "kept"
    folder.mkdir()
    in_files, in_memory = (
        load(Request((tmp_path / "rest.npz",)), folder),
        load(Request((tmp_path / "rest.npz",))),
    )
    assert len(list(folder.iterdir())) == 2
    workers = Processes(1)
    try:
        for name, series in in_files.axes.items():
            assert isinstance(series.y, np.memmap)
            np.testing.assert_array_equal(series.y, in_memory.axes[name].y)
            assert workers.submit(np.sum, series.y).result() == series.y.sum()
            assert workers.submit(np.sum, series.y[5:]).result() == series.y[5:].sum()
    finally:
        workers.close()
