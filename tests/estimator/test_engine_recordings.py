"""Tests of the engine on long series: the compressed memory is compared with the exact one, and estimates are
tested with lost samples.
"""

from pathlib import Path

import numpy as np
import pytest
from fltea.estimator.engine import Engine
from fltea.noise.simulation import FractionalNoise
from fltea.recording.npz_file import open_npz

from tests.rig.engine_cases import GYROSCOPE, with_
from tests.rig.tiers import slow


@pytest.mark.parametrize(
    ("variant", "guard", "samples"),
    [
        ("triple", "off", 30_000),
        ("joint", "consistent", 30_000),
        slow("triple", "off", 100_000),
        slow("joint", "consistent", 100_000),
    ],
)
def test_many_real_samples(recordings: Path, variant: str, guard: str, samples: int) -> None:
    """The series consists of two axes of a real recording of ten minutes, one after the other.

    The memory in use does not grow from the first half to the second.
    """
    recording = open_npz(recordings / "mpu6050_sunsided_10min.npz").whole()
    rates = recording.gyro / recording.lsb_per_dps
    y = (rates - rates.mean(axis=0))[:, :2].T.reshape(-1, 1)[:samples]
    runs = [
        Engine(1, with_(GYROSCOPE, memory=memory, variant=variant, guard=guard, R=y.var())).run(y)
        for memory in ("direct", "compressed")
    ]
    for name, bound in (("x", 1e-6), ("alpha", 1e-6), ("f", 1e-4)):
        difference = np.abs(getattr(runs[0], name) - getattr(runs[1], name))
        assert difference.max() < bound, name
        halves = difference[: samples // 2].max(), difference[samples // 2 :].max()
        assert halves[1] < 20 * halves[0] + bound / 100, (name, halves)


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
    """Lost samples change the estimates by less than the scatter between series that differ only in their
    noise, or by less than the filter's σ if that is larger.
    """
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
