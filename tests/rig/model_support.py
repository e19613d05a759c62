"""Compute noise models by closed forms in numpy, without the native code, and draw samples of them."""

import re
from collections.abc import Sequence

import msgspec
import numpy as np
import pytest
from fltea.noise import parts as p
from fltea.records.arrays import Array
from fltea.spectrum.evidence import Evidence
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.questions import Verdict
from fltea.spectrum.verdict import winner
from hypothesis import strategies as st

from tests.rig.identify_support import H
from tools.validation.closed_form import closed_form
from tools.validation.closed_form import samples as drawn


def order(alpha: float, share: float, Q: float) -> p.Order:
    return p.Order(alpha, -share * 2**alpha / H**alpha, Q)


positive, hz = st.floats(0.01, 100), st.floats(0.3, 45.0)
PARTS: dict[str, st.SearchStrategy[p.AnyPart]] = {
    "relaxation": st.builds(p.Relaxation, positive, st.floats(0.002, 100)),
    "alternating": st.builds(p.Alternating, positive, st.floats(0.002, 10)),
    "walk": st.builds(p.Walk, positive),
    "order": st.builds(order, st.floats(0.05, 1.95), st.floats(0.001, 0.95), positive),
    "arfima": st.builds(p.Arfima, st.floats(0.05, 0.95), st.floats(0.0, 0.99), positive),
    "resonance": st.builds(p.Resonance, positive, hz, st.floats(0.1, 5)),
    "quantisation": st.builds(p.Quantisation, positive),
    "rise": st.builds(p.Rise, positive, st.floats(0.1, 2)),
    "floor": st.builds(p.Floor, positive),
    "low-pass": st.builds(p.LowPass, st.floats(1, 90), st.floats(1.01, 20)),
    "high-pass": st.builds(p.HighPass, st.floats(0.01, 9.9), st.floats(1.01, 8)),
    "sharpening": st.builds(p.Sharpening, st.floats(-0.24, 1)),
    "notch": st.builds(p.Notch, hz, st.floats(0.5, 10)),
    "mean": st.builds(p.Mean, st.integers(2, 10)),
}
"""Strategies of hypothesis that draw a random part of a noise model at 100 Hz, by the kind of part."""
EXAMPLES: dict[str, p.AnyPart] = {
    "white": p.White(1.0),
    "relaxation": p.Relaxation(1.0, 0.3),
    "walk": p.Walk(0.3),
    "order": p.Order(0.5, -0.434, 81.8),
    "resonance": p.Resonance(8.0, 12.0, 2.0),
    "quantisation": p.Quantisation(0.01),
    "rise": p.Rise(8.0, 0.6),
    "low-pass": p.LowPass(15.0, 4.0),
    "high-pass": p.HighPass(0.3, 1.0),
    "sharpening": p.Sharpening(0.2),
    "notch": p.Notch(25.0, 5.0),
    "mean": p.Mean(4),
    "alternating": p.Alternating(1.0, 0.04),
    "floor": p.Floor(0.1),
    "arfima": p.Arfima(0.4, 0.9, 0.1),
}
"""One example for each kind of part of a noise model, for samples at 100 Hz. Tests of searches, model files,
navigation files and systems go through this table.
"""


def samples(parts: Sequence[p.Part], n: int, h: float, seed: int) -> Array:
    """Draw n Gaussian samples with the spectrum of the parts of a noise model.

    The samples are a section of a longer periodic series.
    """
    return drawn(parts, n, h, np.random.default_rng((28, seed)))


def bins(parts: Sequence[p.Part], n: int, h: float, seed: int | None, size: int = 130) -> Binned:
    """Draw a binned periodogram of n samples from the distribution that theory predicts for these parts.

    If `seed` is None, the spectrum itself is returned, without scatter.
    """
    edges = np.geomspace(25 / n, np.pi, size + 1)
    lam = (edges[1:] + edges[:-1]) / 2
    counts = np.maximum(1.0, np.diff(edges) * n / (2 * np.pi))
    power = closed_form(parts, lam, h)
    if seed is not None:
        power = power * np.random.default_rng((29, seed)).gamma(counts) / counts
    return Binned(lam, counts, power[np.newaxis])


def sound(e: Evidence, verdict: Verdict) -> None:
    """Check that a verdict's text, figures and model agree, and that each figure lies in its interval."""
    assert verdict.text == f"{verdict.what} {verdict.why} {verdict.next}"
    for sentence in (verdict.what, verdict.why, verdict.next):
        assert sentence[0].isupper() or sentence[0].isdigit()
        assert sentence.endswith(".")
        assert "  " not in sentence
    assert "0.00 Hz" not in verdict.text
    msgspec.json.encode(verdict)
    order = verdict.order
    orders = [float(one) for one in re.findall(r"of the order (\d\.\d+)", verdict.text)]
    if order.alpha.value is None:
        assert order.f.value is None
    elif orders:
        assert orders == [pytest.approx(order.alpha.value, abs=0.0051)]
    if not verdict.has_order:
        assert order == type(order)()
        assert not orders
    has_order = any(isinstance(part, p.Order | p.Arfima) for part in winner(e, verdict).parts(e.candidates.h))
    assert has_order == (verdict.has_order and (verdict.kind == "fractional" or e.candidates.lead > 0))
    for interval in (order.alpha, order.f, order.F, order.s2, order.R):
        low, value, high = interval.low, interval.value, interval.high
        assert low is None or high is None or value is None or low <= value <= high
