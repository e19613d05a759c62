"""Draw random noise models, and check that the program's claims about each noise are true.

The draws are the same each time. Among hundreds of claims with a confidence of 95 % or more, some have to be
wrong. So the tests count the wrong ones instead of checking single examples.
"""

import math
from collections import Counter

import numpy as np
import pytest
from fltea.identification.sums import examined
from fltea.noise import parts as p
from fltea.spectrum.evidence import Evidence
from fltea.spectrum.verdict import decide

from tests.rig.identify_support import H
from tests.rig.model_support import samples, sound
from tests.rig.random_noises import Parts, drawn
from tests.rig.tiers import long


def is_there(kind: str, parts: Parts) -> bool:
    """Return whether the simulated noise has the kind of part that the verdict claims."""

    def has(*kinds: type[p.Part]) -> bool:
        return any(isinstance(part, kinds) for part in parts)

    match kind:
        case "white" | "undecided":
            return True
        case "fractional":
            return has(p.Order)
        case "relaxations":
            return has(p.Relaxation)
        case "fractional or relaxations":
            return has(p.Order, p.Relaxation, p.Walk)
        case "drift":
            return has(p.Order, p.Relaxation, p.Walk)
        case "low-pass":
            smooths = any(isinstance(part, p.Sharpening) and part.s < 0 for part in parts)
            return smooths or has(p.LowPass, p.Mean, p.Relaxation)
        case "anti-persistent":
            sharpens = any(isinstance(part, p.Sharpening) and part.s > 0 for part in parts)
            return sharpens or has(p.Quantisation, p.Rise)
        case "notch":
            return has(p.Notch)
        case "high-pass":
            return has(p.HighPass)
        case "resonance" | "line or resonance" | "line":
            return has(p.Resonance)
    return False


def says_less_than_it_knows(e: Evidence, kind: str, text: str) -> bool:
    """Return whether the verdict says "white" or "too faint" although another model clearly fits better.

    If the spectrum has a peak, which may explain the better fit, the result is False.
    """
    ahead = -e.candidates.bic(e.candidates.plain) > e.apart
    return ahead and (kind == "white" or "too faint" in text) and not e.peaks


@pytest.mark.parametrize("count", [36, long(200)])
def test_what_is_claimed_is_there(count: int) -> None:
    """What a verdict claims is in the noise. If five verdicts in a hundred claimed too much, this test with
    200 noises would fail with a probability of 97 %.
    """
    rng = np.random.default_rng(28)
    wrong: list[str] = []
    silent: list[str] = []
    kinds: Counter[str] = Counter()
    held = orders = 0
    for i in range(count):
        parts, n = drawn(rng)
        e = examined(samples(parts, n, H, i), H).evidence
        verdict = decide(e)
        sound(e, verdict)
        kinds[verdict.kind] += 1
        if says_less_than_it_knows(e, verdict.kind, verdict.text):
            silent.append(f"{i}: {n} samples of {parts}: {verdict.text}")
        if not is_there(verdict.kind, parts):
            wrong.append(f"{i}: {n} samples of {parts}: {verdict.text}")
        truth = [part.alpha for part in parts if isinstance(part, p.Order)]
        alpha = verdict.order.alpha
        if verdict.kind == "fractional" and truth and alpha.low is not None and alpha.high is not None:
            orders += 1
            held += alpha.low <= truth[0] <= alpha.high
    told = "\n".join([str(kinds), *wrong])
    print(told, held, orders)
    assert not silent, "\n".join(silent)
    assert len(wrong) <= max(1, 0.02 * count), told
    assert sum(": fractional" in one for one in wrong) <= 0.01 * count, told
    assert held >= orders - max(3, 0.1 * orders)


@pytest.mark.parametrize("count", [60, long(200)])
def test_what_is_ahead_of_white_noise_is_said(count: int) -> None:
    """The noises have one or two faint or broad parts: resonances, fast relaxations, rises, filters.

    A verdict must not say "white" or "too faint" if another model clearly fits better. If two verdicts in a
    hundred did, this test with 200 noises would fail with a probability of 98 %.
    """
    rng, silent = np.random.default_rng(45), []
    for i in range(count):
        n, parts = int(rng.choice([3_000, 8_000, 20_000])), [p.White(1.0)]
        height = float(np.exp(rng.uniform(np.log(0.1), np.log(5))))
        hz = math.exp(rng.uniform(math.log(30 / (n * H)), math.log(48)))
        tau = math.exp(rng.uniform(math.log(0.3 * H), math.log(n * H / 20)))
        own = math.exp(-H / tau)
        faint: Parts = [
            p.Resonance(height, hz, hz * rng.uniform(0.05, 0.9)),
            p.Resonance(height, 50 - rng.uniform(2, 12), rng.uniform(1, 12)),
            p.Relaxation(math.sqrt(height * (1 - own) / (1 + own)), tau),
            p.Rise(height, rng.uniform(0.2, 2)),
            p.HighPass(min(hz, 5.0), rng.uniform(1, 2)),
            p.LowPass(rng.uniform(20, 80), rng.uniform(1.2, 4)),
        ]
        parts += [faint[k] for k in rng.choice(len(faint), rng.integers(1, 3), replace=False)]
        e = examined(samples(parts, n, H, i), H).evidence
        verdict = decide(e)
        if says_less_than_it_knows(e, verdict.kind, verdict.text):
            silent.append(f"{i}: {n} samples of {parts}: {verdict.text}")
    assert not silent, "\n".join(silent)
