"""Count on noises without an order: intervals that contain the true value, and false claims of an order.

The intervals are those on composite noises: given sums of parts with arbitrary corner frequencies and sizes.
They count only if the chosen model has exactly the true parts.

The claims are those on mixtures: random relaxations, and white noise that rises with frequency.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from fltea.identification.sums import examined
from fltea.noise import parts as grammar
from fltea.records.arrays import Array
from fltea.spectrum.estimated import estimated
from fltea.spectrum.verdict import decide, winner

from tools.validation.evaluate.cases import H
from tools.validation.gallery.filters import LowPass, Through
from tools.validation.gallery.parts import AR1, Differenced, Part, Relaxation, Walk, White
from tools.validation.runner import Row
from tools.validation.same_parts import found_in_order, in_order, tag

RATE_HZ = 1 / H
LENGTHS = (3_000, 8_000, 20_000, 60_000)
OF_INTERVALS = 60_000
COMPOSITES: dict[str, tuple[Part, ...]] = {
    "relaxation": (White(), Relaxation(0.37, 17.0)),
    "two relaxations": (White(), Relaxation(0.083, 61.0), Relaxation(3.1, 4.3)),
    "walk": (White(), Walk(0.21)),
    "walk, relaxation": (White(), Walk(0.043), Relaxation(2.3, 6.7)),
    "relaxation, angle": (White(), Relaxation(0.71, 13.0), Differenced(0.37)),
    "walk, angle": (Walk(0.13), Differenced(0.77)),
}


def truth_of(parts: Sequence[Part]) -> list[grammar.Part]:
    """Return the parts of a simulated noise as parts of the noise grammar.

    Fits give their results in these parts.
    """
    found: list[grammar.Part] = []
    for part in parts:
        match part:
            case White():
                found.append(grammar.White(1.0))
            case Relaxation():
                sampled = part.sampled(RATE_HZ)
                sigma = sampled.size / math.sqrt(1 - sampled.pole**2)
                found.append(grammar.Relaxation(sigma, 1 / (2 * math.pi * part.hz)))
            case Walk():
                found.append(grammar.Walk(2 * math.pi * part.corner_hz * math.sqrt(H)))
            case Differenced():
                found.append(grammar.Quantisation(H * math.sqrt(part.power)))
    return found


def drawn(parts: Sequence[Part], n: int, rng: np.random.Generator) -> Array:
    """Return n samples of the noise that is the sum of the parts."""
    return np.asarray(sum(part.draw(n, RATE_HZ, rng) for part in parts))


def count_composite(name: str, series: int) -> list[Row]:
    """Count the intervals of each parameter that contain the true value, on records of one composite noise.

    An unknown end of an interval counts as infinitely far away.
    """
    rng = np.random.default_rng([OF_INTERVALS, *name.encode()])
    truth = in_order(truth_of(COMPOSITES[name]))
    held: Counter[str] = Counter()
    told: Counter[str] = Counter()
    same = 0
    for _ in range(series):
        e = examined(drawn(COMPOSITES[name], OF_INTERVALS, rng), H).evidence
        found = found_in_order(estimated(e.candidates, winner(e, decide(e))))
        if [one.part for one in found] != [tag(one) for one in truth]:
            continue
        same += 1
        for number, (one, true) in enumerate(zip(found, truth, strict=True)):
            for parameter, interval in one.values.items():
                low, high, value = interval.low, interval.high, getattr(true, parameter)
                key = f"{parameter} of {one.part} {number}"
                told[key] += low is not None and high is not None
                held[key] += (low is None or low <= value) and (high is None or value <= high)
    row: Row = {"kind": "composites", "noise": name, "samples": OF_INTERVALS, "series": series, "same": same}
    return [row | {"quantity": key, "held": held[key], "told": told[key]} for key in held]


def count_claims(samples: int, series: int) -> list[Row]:
    """Count the verdicts of each kind on random mixtures, which have no order."""
    rng = np.random.default_rng([samples, 28])
    kinds = Counter(
        str(decide(examined(drawn(mixture(rng), samples, rng), H).evidence).kind) for _ in range(series)
    )
    return [{"kind": "claims", "samples": samples, "series": series, "verdicts": dict(kinds.most_common())}]


def mixture(rng: np.random.Generator) -> tuple[Part, ...]:
    """Return the parts of a random mixture of relaxations and white noise that rises with frequency.

    The mixture has one to three relaxations. Either a rising part or a sharpening filter makes the white
    noise rise.
    """
    slow = tuple(
        Relaxation(corner, float(np.exp(rng.uniform(0, 3))) * 10 / (1 + corner))
        for corner in np.exp(rng.uniform(math.log(0.05), math.log(10), rng.integers(1, 4))).tolist()
    )
    sharp = float(rng.uniform(0.02, 0.08))
    rises: tuple[Callable[[], tuple[Part, ...]], ...] = (
        lambda: (White(), *slow, Differenced(float(np.exp(rng.uniform(-3, 0))))),
        lambda: (AR1(-float(rng.uniform(0.1, 0.4)), 1.0), *slow),
        lambda: (Through(LowPass(taps=(-sharp, 1 + 2 * sharp, -sharp)), slow),),
    )
    return rises[rng.integers(len(rises))]()
