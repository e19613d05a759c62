"""The Fisher information that a record's spectrum has of the parameters of a noise model."""

import math
from collections.abc import Sequence

import numpy as np

from fltea.noise.parts import Arfima, Order
from fltea.records.arrays import Array
from fltea.spectrum.candidate_models import CandidateModels, FittedModel

NOTHING = 1e-4
"""If a parameter has less Fisher information than this, the data count as saying nothing about it."""


def information_of(f: CandidateModels, model: FittedModel) -> Array:
    """Return the Fisher information of a model's free parameters, (p, p)."""
    _, rows = slopes(f, model.codes, model.eta)
    return np.asarray((rows * f.data.counts) @ rows.T)


def slopes(f: CandidateModels, codes: Sequence[int], eta: Sequence[float]) -> tuple[Array, Array]:
    """Return a model's spectrum, (bins,), and its logarithm's derivative by each parameter, (p, bins)."""
    total, rows = np.empty(len(f.data.lam)), np.empty((len(eta), len(f.data.lam)))
    f.native.slopes(list(codes), list(eta), total, rows)
    return total, rows


def order_deviation(f: CandidateModels, model: FittedModel) -> float | None:
    """Return the standard deviation of the order, from the Fisher information of all parameters."""
    at = model.place(Order, Arfima)
    if at is None:
        return None
    information = information_of(f, model)
    # The data say nothing about a parameter of a part with negligible power, so this parameter is left out.
    keep = [i for i in range(len(information)) if i == at or information[i, i] > NOTHING]
    try:
        variance = float(np.linalg.inv(information[np.ix_(keep, keep)])[keep.index(at), keep.index(at)])
    except np.linalg.LinAlgError:
        return None
    return math.sqrt(variance) if 0 < variance < 1 else None
