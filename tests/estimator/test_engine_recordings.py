"""The compressed memory on long real recordings: its difference from the exact one stays bounded."""

from pathlib import Path

import numpy as np
import pytest
from engine_cases import GYROSCOPE, with_
from fltea.estimator.engine import Engine
from fltea.recording.npz_file import open_npz
from tiers import slow


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
    """Two axes of the ten-minute recording one after the other, and no growth from each half to the next."""
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
