"""Lost samples: after 1 %, 5 % and 20 % of random loss the estimates agree with the lossless ones."""

import numpy as np
import pytest
from engine_cases import GYROSCOPE, with_
from fltea.estimator.engine import Engine
from fltea.noise.simulation import FractionalNoise

N, LANES, H = 4000, 16, 0.01


def white() -> np.ndarray:
    return np.random.default_rng(1).standard_normal((N, LANES)) * 0.0235**0.5


def fractional() -> np.ndarray:
    columns = [
        FractionalNoise(0.6, -3.0, 1.0, 0.0, H, 1000, (2, lane)).samples(N)[0] for lane in range(LANES)
    ]
    y = np.array(columns).T
    return y * (0.0235**0.5 / y.std())


@pytest.mark.parametrize("noise", [white, fractional])
@pytest.mark.parametrize(
    ("variant", "guard"), [("triple", "off"), ("triple", "consistent"), ("joint", "consistent")]
)
def test_random_losses_do_not_move_the_estimates(noise, variant: str, guard: str) -> None:
    """Spread: of the lanes, which differ in nothing but their noise, or the filter's own, if larger."""
    y = noise()
    settings = with_(GYROSCOPE, memory="compressed", variant=variant, guard=guard)
    whole = Engine(LANES, settings).run(y)
    spread = max(whole.alpha[-1].std(), np.median(np.sqrt(whole.alpha_var[-1])))
    for share in (0.01, 0.05, 0.2):
        missing = np.random.default_rng(3).random((N, LANES)) < share
        lossy = Engine(LANES, settings).run(y, missing=missing)
        assert np.isfinite(lossy.alpha).all()
        shift = lossy.alpha[-1] - whole.alpha[-1]
        assert abs(np.median(shift)) < spread, share
        assert np.sqrt((shift**2).mean()) < 2 * spread, share
