"""Noises that are made of random parts."""

import math

import numpy as np
from fltea.noise import parts as p

from tests.rig.identify_support import H

Parts = list[p.Part]

SLOWEST_SHARE = 20
"""Least ratio of a record's length to the correlation time of a relaxation."""


def drawn(rng: np.random.Generator) -> tuple[Parts, int]:
    """Draw a random noise model and the number of samples."""
    n = int(rng.choice([3_000, 8_000, 20_000, 60_000, 200_000]))
    parts: Parts = [p.White(1.0)]

    def level() -> float:
        """Draw the density of one part of the noise model, relative to that of the white noise."""
        return float(np.exp(rng.uniform(np.log(0.5), np.log(300))))

    if rng.random() < 0.35:
        alpha, corner = rng.uniform(0.25, 0.75), np.exp(rng.uniform(np.log(2e-3), np.log(0.5)))
        g = -(corner**alpha)
        parts.append(p.Order(alpha, g / H**alpha, level() * g**2 / H ** (2 * alpha)))
    else:
        for _ in range(rng.integers(0, 4)):
            tau = math.exp(rng.uniform(math.log(2 * H), math.log(n * H / SLOWEST_SHARE)))
            phi = math.exp(-H / tau)
            parts.append(p.Relaxation(math.sqrt(level() * (1 - phi) / (1 + phi)), tau))
        if rng.random() < 0.2:
            parts.append(p.Walk(math.sqrt(level() / H) * 20 / n))
    if rng.random() < 0.25:
        parts.append(p.Quantisation(H * math.sqrt(level() / 20)))
    if rng.random() < 0.1:
        hz = rng.uniform(5, 40)
        parts.append(p.Resonance(level(), hz, hz * rng.uniform(0.1, 0.3)))
    if rng.random() < 0.3:
        filters: Parts = [
            p.LowPass(rng.uniform(8, 40), rng.uniform(1.5, 6)),
            p.Sharpening(rng.uniform(-0.1, 0.2)),
            p.Notch(rng.uniform(10, 40), rng.uniform(3, 8)),
            p.Mean(int(rng.integers(2, 5))),
            p.HighPass(math.exp(rng.uniform(math.log(30 / (n * H)), math.log(3))), rng.uniform(1, 2)),
        ]
        parts.append(filters[rng.integers(len(filters))])
        parts.append(p.Floor(1e-3))
    return parts, n
