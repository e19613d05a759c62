"""The figures of the noise model that a verdict chooses: its parts, the order, N and K.

A single model stands for the noise wherever its figures are used: in tables, in files for navigation filters,
in simulations. N comes from this model's white noise and K from its random walk. A relaxation that is about
as fast as the sample rate may really be the sensor's white noise after a filter. In this case N is not known,
and only the density at the relaxation's corner frequency (its knee) is reported.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, cast

import msgspec
import numpy as np

from fltea.noise.parts import AnyPart, Relaxation
from fltea.records.arrays import Array
from fltea.records.fit import Interval, Level
from fltea.spectrum.angle_walk import angle_walk
from fltea.spectrum.candidate_models import CandidateModels, FittedModel
from fltea.spectrum.estimated import Estimated, estimated
from fltea.spectrum.evidence import Evidence
from fltea.spectrum.questions import Verdict
from fltea.spectrum.reading import corner_hz
from fltea.spectrum.verdict import winner
from fltea.spectrum.wording import names


class ModelSummary(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A noise model that was fitted. It may be the one that stands for the noise, or another candidate."""

    name: str
    parts: tuple[AnyPart, ...]
    parameters: int
    """Number of parameters that BIC counts."""
    log_likelihood: float
    bic: float
    """BIC of the model minus that of white noise. A lower value is better."""


class NoiseFigures(NamedTuple):
    """The model that the verdict chooses for the noise, and its figures."""

    model: FittedModel
    parts: tuple[Estimated, ...]
    """The parts of the model, with 95 % intervals of their parameters."""
    level: Level

    def spectrum(self, h: float) -> Callable[[Array], Array]:
        """Return a function that returns the model's spectrum at λ > 0 [rad a sample].

        `h`: sampling period [s].
        """
        return lambda lam: self.model.spectrum(np.ascontiguousarray(lam), h)


def noise_figures(e: Evidence, verdict: Verdict) -> NoiseFigures:
    """Return the figures of the model that the verdict chooses."""
    f = e.candidates
    model = winner(e, verdict)
    parts = tuple(sorted(estimated(f, model), key=_place))
    return NoiseFigures(model, parts, level(parts, f, model))


def _place(one: Estimated) -> tuple[int, float]:
    """Return the key by which a list of parts is sorted.

    White noise comes first, then relaxations from slow to fast, then all others.
    """
    if one.part == "relaxation":
        return 1, -one.value("tau_s")
    return 0 if one.part == "white" else 2, 0.0


def level(found: Sequence[Estimated], f: CandidateModels, model: FittedModel) -> Level:
    """Return N and K of one of the candidate models `f`.

    `found`: the parts of the model with their intervals, among them the random walk, which gives K.
    """
    h = f.h
    by_kind = {one.part: one for one in found}
    K = by_kind["walk"].values["K"] if "walk" in by_kind else Interval()
    N = angle_walk(f, model)
    if N.value is not None:
        return Level(N, K)
    relaxations = [part for part in model.parts(h) if isinstance(part, Relaxation)]
    if not relaxations:
        return Level(N, K)
    knee_hz = min(max(map(corner_hz, relaxations)), 0.5 / h)
    lam = np.array([min(2 * np.pi * knee_hz * h, np.pi)])
    return Level(N, K, knee_hz, math.sqrt(float(model.spectrum(lam, h)[0]) * h))


def summaries(f: CandidateModels) -> dict[str, ModelSummary]:
    """Return the candidate models by their names. A model that does not exist is left out."""
    known = {name: getattr(f, name) for name in ("white", "plain", "rich", "pure", "ordered", "order")}
    return {name: _summary(f, one) for name, one in known.items() if one is not None}


def _summary(f: CandidateModels, one: FittedModel) -> ModelSummary:
    parts = one.parts(f.h)
    bic = round(f.bic(one), 6) + 0.0  # adding 0 turns -0 into 0
    return ModelSummary(names(one.kinds), cast(tuple[AnyPart, ...], parts), one.parameters, -one.nll, bic)
