"""A drift that goes up and stays there is in the lowest frequencies only."""

import numpy as np
import pytest
from fltea.spectrum.octaves import Octaves

H, N = 0.01, 60_000


@pytest.mark.parametrize("drift", ["ramp", "exponential"])
def test_drift_does_not_leak(drift: str) -> None:
    """20 σ in ten minutes under white noise: from 0.02 Hz on, where drift ends by name, white is left."""
    t = np.arange(N) / N
    offset = 20 * (t if drift == "ramp" else -np.expm1(-3 * t))
    lanes = 8
    octaves = Octaves(lanes)
    octaves.add(np.random.default_rng(3).standard_normal((N, lanes)) + offset[:, np.newaxis])
    spectra = [octaves.periodogram(lane, H) for lane in range(lanes)]
    hz = spectra[0].lam / (2 * np.pi * H)
    power = np.mean([one.power for one in spectra], axis=0)
    for low, high in ((0.02, 0.05), (0.05, 0.2), (0.2, 1.0)):
        band = (hz >= low) & (hz < high)
        error = 1 / np.sqrt(lanes * band.sum())
        assert power[band].mean() == pytest.approx(1, abs=5 * error), (low, high)


def test_what_was_taken_out_is_told() -> None:
    """Of white noise as much as it has at other frequencies; of a short record, where it is left, too."""
    lanes = 40
    octaves = Octaves(lanes)
    y = np.random.default_rng(4).standard_normal((20_000, lanes))
    octaves.add(y[:3000])
    short = [octaves.lines_and_drift(lane, H)[1] for lane in range(lanes)]
    assert np.mean([one.power for one in short if one]) == pytest.approx(1, abs=4 * np.sqrt(2 / 3 / lanes))
    octaves.add(y[3000:])
    found = [octaves.lines_and_drift(lane, H)[1] for lane in range(lanes)]
    assert {one.amplitudes for one in found if one} == {3}
    assert np.mean([one.power for one in found if one]) == pytest.approx(1, abs=4 * np.sqrt(2 / 3 / lanes))
    octaves.skip(1000)
    octaves.add(y[:5000] + 3)
    gap = octaves.lines_and_drift(0, H)[1]
    assert gap is not None
    assert (gap.amplitudes, gap.power < 5) == (6, True)
    ramp = Octaves(1)
    ramp.add(y[:, :1] + np.linspace(0, 1, 20_000)[:, np.newaxis])
    steep = ramp.lines_and_drift(0, H)[1]
    assert steep is not None
    assert steep.power == pytest.approx(20_000 / 12 / 3, rel=0.1)
