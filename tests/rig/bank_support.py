"""Helpers for the tests of the native filter bank, which filters all axes of a sensor in blocks of samples
(rows).

The helpers are an oracle that processes samples one by one, and ways to split rows into blocks.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from fltea.estimator.bank import Bank
from fltea.estimator.engine import CAUSES
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import LaneBlock, Lost
from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig
from numpy.typing import NDArray

from tests.rig.sample_by_sample import LanesBySample, baseline, whiteness

H = 0.01
AXES = ("gyro_x", "gyro_y", "gyro_z")
COLUMNS = LaneBlock._fields[: LaneBlock._fields.index("lost")]
"""Names of the bank's output columns that are compared with those of the oracle."""


class Walked(NamedTuple):
    """Results of an estimator for n samples.

    `columns`: outputs after each sample, of shape (n, axes), by name. The fields after `lost` are figures of
    the whole run, such as how often the filters of each axis restarted.
    """

    columns: dict[str, NDArray[np.float64] | NDArray[np.bool_]]
    lost: list[Lost]
    """Axes that became invalid, each with the number of the row. Rows of missing samples are not counted."""
    restarts: dict[str, int]
    interventions: dict[str, dict[str, int]]
    lag1: dict[str, float | None]
    nis: dict[str, float | None]
    is_white: dict[str, bool | None]
    bias: tuple[float, ...]
    R: tuple[float, ...]
    constant: tuple[str, ...]


Gaps = dict[int, int]
"""Number of missing samples before each row that follows a gap."""


def by_sample(
    y: Array, config: EstimatorConfig, lsb: float | None = None, gaps: Gaps | None = None
) -> Walked:
    """Return the results of the oracle, which filters one sample after the other in Python."""
    (n, width), first = y.shape, config.startup_needed
    axes = AXES[:width]
    bias, R, constant = baseline(y[:first], config, lsb)
    live = np.flatnonzero(~constant)
    lanes = LanesBySample(len(live), LaneSettings(config, H, R[live])) if len(live) else None
    columns, valid = np.full((n, 7, width), np.nan), np.zeros((n, width), dtype=bool)
    innovations: list[list[tuple[float, float] | None]] = [[] for _ in axes]
    lost = []
    for k in range(first, n if lanes else 0):
        missing = (gaps or {}).get(k, 0)
        for _ in range(missing):
            lanes.step(np.zeros(len(live)), missing=True)
        columns[k][:, live], valid[k, live], news = lanes.step(y[k, live] - bias[live])
        lost += [Lost(k, int(live[lane]), why) for lane, why in news.items()]
        for axis, of_axis in enumerate(innovations):
            of_axis += [None] * min(missing, 1)
            of_axis.append((columns[k, 5, axis], columns[k, 6, axis]) if valid[k, axis] else None)
    counts = iter(zip(lanes.restarts, lanes.engine.interventions().tolist(), strict=True) if lanes else ())
    restarts = dict.fromkeys(axes, 0)
    interventions: dict[str, dict[str, int]] = {axis: {} for axis in axes}
    for axis, (again, causes) in zip(live.tolist(), counts, strict=True):
        restarts[axes[axis]] = int(again)
        interventions[axes[axis]] = {cause: n for cause, n in zip(CAUSES, causes, strict=True) if n}
    white = dict(zip(axes, map(whiteness, innovations), strict=True))
    return Walked(
        dict(zip(COLUMNS, (*columns.transpose(1, 0, 2), valid), strict=True)),
        lost,
        restarts,
        interventions,
        *({axis: one[i] for axis, one in white.items()} for i in range(3)),
        tuple(bias.tolist()),
        tuple(np.where(constant, np.nan, R).tolist()),
        tuple(axis for axis, still in zip(axes, constant, strict=True) if still),
    )


def blocks(n: int, cuts: Sequence[int]) -> list[range]:
    """Split `n` rows, in order, at `cuts`."""
    edges = sorted({0, n, *(cut for cut in cuts if 0 < cut < n)})
    return [range(a, b) for a, b in itertools.pairwise(edges)]


def by_bank(
    y: Array,
    config: EstimatorConfig,
    lsb: float | None = None,
    gaps: Gaps | None = None,
    cuts: Sequence[int] = (),
    bank: Bank | None = None,
) -> Walked:
    """Return the bank's results for rows that are processed in blocks.

    A block ends at each number in `cuts`, at each gap and at the end of the start-up window.
    """
    axes = AXES[: y.shape[1]]
    bank = bank or Bank(axes, config, H, lsb)
    parts, lost = [], []
    for block in blocks(len(y), [*cuts, *(gaps or {}), bank.startup_remaining]):
        bank.on_missing((gaps or {}).get(block.start, 0))
        found = bank.run(y[block.start : block.stop])
        assert block.start >= config.startup_needed or np.isnan(found[:7]).all()
        lost += [one._replace(row=one.row + block.start) for one in found.lost]
        parts.append(found)
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS}
    assert bank.baseline is not None
    return Walked(
        columns,
        lost,
        bank.restarts,
        bank.interventions,
        bank.lag1,
        bank.nis,
        bank.is_white,
        *bank.baseline,
    )


def fed_directly(y: Array, config: EstimatorConfig, lsb: float) -> list[dict[str, dict[str, object]]]:
    """Return the estimates after each sample that follows the start-up window.

    The estimates after one sample are a dict by axis. The names of the fields are those of an `estimate`
    record.
    """
    columns = by_bank(y, config, lsb).columns
    names = {"alpha": "alpha", "alpha_std": "alpha_std", "f": "f", "f_std": "f_std"}
    names |= {"state": "x", "innovation": "innovation", "valid": "valid"}
    rows = zip(*(columns[column][config.startup_needed :].tolist() for column in names.values()), strict=True)
    return [
        {
            axis: dict(zip(names, of_axis, strict=True))
            for axis, of_axis in zip(AXES, zip(*row, strict=True), strict=True)
        }
        for row in rows
    ]


def assert_published(
    records: Sequence[dict[str, Any]], expected: Sequence[dict[str, dict[str, object]]]
) -> None:
    """Check that every number of these `estimate` records equals the expected one to the bit."""
    for record, of_axes in zip(records, expected, strict=True):
        assert record["axes"].keys() == of_axes.keys()
        for axis, numbers in of_axes.items():
            own = record["axes"][axis]["fltea"]
            assert own | numbers == own, (record["seq"], axis)


def assert_same(found: Walked, expected: Walked) -> None:
    for name in COLUMNS:
        np.testing.assert_array_equal(found.columns[name], expected.columns[name], err_msg=name)
    assert found[1:] == expected[1:]


def assert_close(found: Walked, expected: Walked, tolerance: float = 1e-9) -> None:
    """Check that two estimators have the same results, except for rounding.

    They may round the mean of the start-up window differently, and this changes all later results a little.
    """
    np.testing.assert_allclose(found.bias, expected.bias, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found.R, expected.R, rtol=1e-12)
    assert found.constant == expected.constant
    for name in COLUMNS:
        a, b = found.columns[name], expected.columns[name]
        if a.dtype == bool:
            np.testing.assert_array_equal(a, b, err_msg=name)
        else:
            np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance, err_msg=name)
    assert found.lost == expected.lost
    assert found.restarts == expected.restarts
    assert found.interventions == expected.interventions
    assert found.is_white == expected.is_white
    for mine, others in ((found.lag1, expected.lag1), (found.nis, expected.nis)):
        for axis, value in others.items():
            ours = mine[axis]
            if value is None or not math.isfinite(value):
                assert ours is None
            else:
                assert ours is not None
                assert math.isclose(ours, value, rel_tol=1e-8, abs_tol=1e-9)
