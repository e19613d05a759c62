"""Invent results of a live fit, for the tests of the live page."""

import numpy as np
from fltea.records.fit import AxisFit, FitAllan, FitSpectrum, Interval, Until
from fltea.records.records import AnyRecord, Fit, Sample
from msgspec.structs import replace

FRACTIONAL = AxisFit(
    "fractional",
    "Noise of fractional order, α = 0.80, in white noise.",
    "deg/s",
    null_p=1e-40,
    alpha=Interval(0.803, 0.762, 0.847),
    f=Interval(-1.02, -1.31, -0.77),
    F=Interval(0.77, 0.73, 0.81),
    s2=Interval(0.003, 0.0025, 0.0035),
    R=Interval(0.001, 0.0008, 0.0012),
    until_s=Until(0.05, 0.0),
)
WHITE = AxisFit(
    "white",
    "White noise, so there is no order: α and f are undefined.",
    "deg/s",
    null_p=0.4,
    alpha=Interval(0.09),
    f=Interval(-1.0),
    until_s=Until(0.05),
)
UNDECIDED = AxisFit(
    "undecided",
    "Not white; it looks fractional (α = 0.66), but in 123 s a sum of relaxations looks the same: record ten "
    "minutes or more. There is also a line at 12.0 Hz (3.1% of the power).",
    "deg/s",
    null_p=1e-9,
    alpha=Interval(0.66, 0.41, 0.97),
    f=Interval(-2.1, -6.0, 0.4),
    rate_left_out=[(11.4, 12.7), (24.0, 25.0)],
    left_out={"knocked": 256, "bridged": 7, "lost": 12},
    breaks={"gaps": 1, "knocks": 2, "steps": 1, "changes": 0},
    until_s=Until(0.05, 440.0),
)


def curves(scale: float = 1.0, points: int = 110) -> tuple[FitSpectrum, FitAllan]:
    """Return a spectrum and an Allan deviation of roughly the same noise, with realistic scatter."""
    rng = np.random.default_rng(5)
    hz = np.geomspace(0.02, 49, points)
    model = scale * np.sqrt(1e-5 + 3e-5 / (1 + (hz / 0.3) ** 1.6))
    tau = 0.01 * 2.0 ** np.arange(13)
    adev = scale * np.sqrt(1e-5 / (2 * tau) + 1e-6 + 1e-7 * tau / 3)
    ratio = 1 + 0.02 * 2 ** (np.arange(13) / 3)
    spectrum = FitSpectrum(
        hz.tolist(), (model * np.exp(0.1 * rng.standard_normal(points))).tolist(), model.tolist()
    )
    allan = FitAllan(
        tau.tolist(), adev.tolist(), (adev / ratio).tolist(), (adev * ratio).tolist(), (adev * 1.02).tolist(),
        N=scale * 2.2e-3, B=scale * 1.5e-3,
    )  # fmt: skip
    return spectrum, allan


def with_curves(fit: AxisFit, scale: float = 1.0) -> AxisFit:
    spectrum, allan = curves(scale)
    return replace(fit, spectrum=spectrum, allan=allan)


def fit_after(sample: Sample, axes: dict[str, AxisFit], samples: int | None = None) -> Fit:
    place = sample.seq, sample.epoch, sample.device_us, sample.host_ns
    return Fit(*place, sample.seq if samples is None else samples, axes, device=sample.device)


def with_fits(found: list[AnyRecord], axes: dict[str, AxisFit], every: int = 100) -> list[AnyRecord]:
    """Return the records with the record of a live fit inserted after every `every` samples."""
    made: list[AnyRecord] = []
    for record in found:
        made.append(record)
        if isinstance(record, Sample) and record.seq % every == every - 1:
            made.append(fit_after(record, axes))
    return made
