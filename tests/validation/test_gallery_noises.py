"""The samples of the gallery's noises have the spectra that the noises' closed forms give. An independent
periodogram shows this.
"""

import ast
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import welch

from tools.validation import recursions
from tools.validation.gallery.noise import Drift, Line, bursts, outliers, rounded, step, wander
from tools.validation.gallery.noises import NOISES
from tools.validation.gallery.parts import Fractional, Relaxation
from tools.validation.recursions import FractionalState

# the tests in this file check a reference of other tests, and no part of the program
pytestmark = pytest.mark.slow

GENERATORS = ("../recursions", "parts", "noise", "noises", "periodic", "contrast")
SAMPLES, SEGMENT = 1 << 16, 1 << 11
RATE_HZ = 100.0
PLAIN = [name for name, noise in NOISES.items() if noise.treatment is None]


@pytest.mark.parametrize("module", GENERATORS)
def test_nothing_is_shared_with_the_fits(module: str) -> None:
    """The gallery of `make validate`, which judges verdicts, shares no code with the fits that it judges.

    This is so for its noises, and for its rules on which verdicts are right.
    """
    source = (Path(recursions.__file__).parent / "gallery" / f"{module}.py").read_text(encoding="utf-8")
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [one.name for one in node.names]
        elif isinstance(node, ast.ImportFrom):
            names.append(node.module or "")
    ours = [name for name in names if name.startswith(("fltea", "tools"))]
    # the shared modules only define names, types and the recursion of the fractional state
    shared = ("fltea.records.fit", "fltea.records.arrays", "tools.validation.recursions")
    assert all(name.startswith("tools.validation.gallery.") or name in shared for name in ours)


@pytest.mark.parametrize("name", PLAIN)
def test_spectrum(name: str) -> None:
    """In each band of frequencies, Welch's periodogram has the power of the closed form."""
    noise = NOISES[name]._replace(lines=(), drift=None)
    y = noise.draw(SAMPLES, RATE_HZ, np.random.default_rng(5))
    _, power = welch(y, window="hann", nperseg=SEGMENT, scaling="density", fs=2 * np.pi)
    power *= np.pi  # now white noise of variance R has the power R at each frequency
    lam = 2 * np.pi * np.arange(SEGMENT // 2 + 1) / SEGMENT
    edges = np.unique(np.geomspace(5, SEGMENT // 2 - 3, 9).astype(int))
    # In Welch's periodogram, the window of a short segment smears steep spectra. So the closed form is
    # smeared in nearly the same way, by a weighted mean over neighbouring frequencies.
    fine = np.linspace(-1.5, 1.5, 31)
    near = noise.spectrum((lam[5:, np.newaxis] + fine * lam[1]).ravel(), RATE_HZ).reshape(-1, len(fine))
    weight = np.cos(np.pi * fine / 4) ** 8
    smeared = np.concatenate([np.ones(5), near @ weight / weight.sum()])
    for begin, end in itertools.pairwise(edges):
        expected, got = smeared[begin:end].sum(), power[begin:end].sum()
        # `share` is 1 / n with an effective number n of ordinates: the power of a band of n ordinates with
        # equal means would scatter from record to record as much as the power of this band
        share = (smeared[begin:end] ** 2).sum() / expected**2
        spread = math.sqrt(share / (SAMPLES / SEGMENT * 1.3))
        assert got / expected == pytest.approx(1, abs=5 * spread + 0.03), f"ordinates {begin} to {end}"


@pytest.mark.parametrize("name", ["every 10th repeated", "slow chip", "white", "1 relaxation"])
def test_drawn_again_is_the_same(name: str) -> None:
    first, again = (NOISES[name].draw(1_000, 5.0, np.random.default_rng(3)) for _ in range(2))
    assert (first == again).all()
    assert (first != NOISES[name].draw(1_000, 5.0, np.random.default_rng(4))).any()


@pytest.mark.parametrize("rate_hz", [5.0, 100.0, 1_000.0])
@pytest.mark.parametrize("name", list(NOISES))
def test_every_rate(name: str, rate_hz: float) -> None:
    noise = NOISES[name]
    y = noise.draw(150, rate_hz, np.random.default_rng(1))
    assert y.shape == (150,)
    assert np.isfinite(y).all()
    density = noise.spectrum(np.linspace(0.01, 3.1, 50), rate_hz)
    assert (density > 0).all()
    assert np.isfinite(density).all()


def test_what_is_drawn_is_stationary_from_its_first_sample_on() -> None:
    rng = np.random.default_rng(7)
    state, relaxation = FractionalState(0.6, -0.02, 64), Relaxation(0.05, 100.0)
    pole = math.exp(-2 * math.pi * relaxation.hz / RATE_HZ)
    first = np.array([relaxation.draw(1, RATE_HZ, rng)[0] for _ in range(4_000)])
    assert first.var() == pytest.approx(100 * (1 - pole) / (1 + pole), rel=0.1)
    x = np.array([state.draw(rng) for _ in range(400)])
    assert x.shape == (400, 64)
    assert x[:, [0, -1]].var(axis=0) == pytest.approx(state.power, rel=0.3)


def test_states_stay_stationary_at_slow_rates() -> None:
    for noise in NOISES.values():
        for part in noise.parts:
            if isinstance(part, Fractional):
                for rate_hz in (5.0, 100.0, 1_000.0):
                    assert -(2**part.alpha) < part.g(rate_hz)
                    assert part.g(rate_hz) < part._weights().sum() if part.window else part.g(rate_hz) <= 0


def test_lines_fold() -> None:
    hum = Line(50.02, 1.0)
    assert hum.folded(100.0) == pytest.approx(49.98)
    assert hum.folded(1_000.0) == pytest.approx(50.02)
    assert hum.folded(5.0) == pytest.approx(0.02)
    assert Line(0.03, 1.0, "nyquist").folded(100.0) == pytest.approx(49.97)
    power = np.abs(np.fft.rfft(hum.draw(50_000, 100.0, np.random.default_rng(1)))) ** 2
    assert power.argmax() * 100.0 / 50_000 == pytest.approx(49.98)


def test_treatments() -> None:
    y, rng = np.random.default_rng(9).standard_normal(200_000), np.random.default_rng(10)
    coarse = rounded(0.1)(y, rng)
    assert set(coarse.tolist()) <= {-1.0, 0.0, 1.0}
    assert 0.015 < (coarse != 0).mean() < 0.035
    assert (np.abs(outliers(y, rng)) == 20).mean() == pytest.approx(1e-3, rel=0.3)
    assert np.abs(bursts(y, rng)).max() > 50
    halves = np.split(step(y, rng), 2)
    assert halves[1].var() / halves[0].var() == pytest.approx(2, rel=0.03)
    quarters = np.split(wander(y, rng), 4)
    assert quarters[0].var() / quarters[2].var() > 2
    assert Drift(3.0).draw(100)[[0, -1]].tolist() == pytest.approx([0, 2.97])
