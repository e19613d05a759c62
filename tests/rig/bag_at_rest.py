"""A sensor at rest, whose samples the tests write to bags; and what was read of a bag."""

from typing import Any

import numpy as np
from fltea.recording.files import Stored

from tests.rig.bag_support import START_NS

N, RATE_HZ = 1500, 200.0
STAMPS = (START_NS + np.arange(N) * 5_000_000).tolist()
N_DPS = np.array([0.6, 0.9, 1.2])
BIAS_DPS = np.array([0.5, -0.3, 0.2])


def at_rest(noise: float = 1.0, bias: float = 1.0, seed: int = 1) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return angular rates of a sensor at rest in deg/s."""
    rng = np.random.default_rng(seed)
    sigma = noise * N_DPS / 60 * np.sqrt(RATE_HZ)
    return np.asarray(rng.normal(bias * BIAS_DPS, sigma, (N, 3)))


def answers(stored: Stored) -> dict[str, tuple[str, str]]:
    return {answer.question: (answer.value, answer.evidence) for answer in stored.reading}
