"""What tests of the bank share: the sample-by-sample oracle in the bank's own columns, and cuts of rows."""

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from fltea.estimator.bank import Bank, BankBlock
from fltea.estimator.lanes import Lost
from fltea.settings.estimator import EstimatorConfig
from numpy.typing import NDArray
from sample_by_sample import OnlineEstimator, Whiteness

Array = NDArray[np.float64]
H = 0.01
AXES = ("gyro_x", "gyro_y", "gyro_z")
COLUMNS = BankBlock._fields[1:-1]
"""All of the columns."""


class Walked(NamedTuple):
    """What an estimator made of all rows: columns (n, axes) by name, and its counts at the end."""

    columns: dict[str, NDArray[np.float64] | NDArray[np.bool_]]
    lost: list[Lost]
    """rows count samples that were there"""
    restarts: dict[str, int]
    interventions: dict[str, dict[str, int]]
    lag1: dict[str, float | None]
    nis: dict[str, float | None]
    describes_noise: dict[str, bool | None]
    bias: tuple[float, ...]
    R: tuple[float, ...]
    constant: tuple[str, ...]


Gaps = dict[int, int]
"""So many samples are missing before that row."""


def by_sample(
    y: Array, config: EstimatorConfig, lsb: float | None = None, gaps: Gaps | None = None
) -> Walked:
    """The oracle's way."""
    axes = AXES[: y.shape[1]]
    live = OnlineEstimator(axes, config, H, lsb)
    white = {axis: Whiteness() for axis in axes}
    rows, lost = [], []
    for k, row in enumerate(y.tolist()):
        missing = (gaps or {}).get(k, 0)
        live.on_missing(missing)
        if missing:
            for one in white.values():
                one.skip()
        found = live.on_sample(tuple(row))
        for axis, e in (found or {}).items():
            if e.valid:
                white[axis].add(e.innovation_dps, e.innovation_std_dps)
            else:
                white[axis].skip()
        lost += [Lost(k, axes.index(axis), why) for axis, why in live.lost.items()]
        seven = [tuple(e[:7]) for e in found.values()] if found else [(math.nan,) * 7] * len(axes)
        valid = [e.valid for e in found.values()] if found else [False] * len(axes)
        rows.append([*np.array(seven).T, valid])
    columns = {name: np.array([row[i] for row in rows]) for i, name in enumerate(COLUMNS)}
    assert live.baseline is not None
    return Walked(
        columns,
        lost,
        live.restarts,
        {axis: live.interventions.get(axis, {}) for axis in axes},
        {axis: one.lag1 for axis, one in white.items()},
        {axis: one.nis for axis, one in white.items()},
        {axis: one.describes_noise for axis, one in white.items()},
        *live.baseline,
    )


def blocks(n: int, cuts: Sequence[int]) -> list[range]:
    """All rows in order, cut at `cuts`."""
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
    """The bank's way, in blocks that end at the cuts, at the gaps and with the start-up window."""
    axes = AXES[: y.shape[1]]
    bank = bank or Bank(axes, config, H, lsb)
    parts, lost = [], []
    for block in blocks(len(y), [*cuts, *(gaps or {}), bank.startup_remaining]):
        bank.on_missing((gaps or {}).get(block.start, 0))
        found = bank.run(y[block.start : block.stop])
        assert found.estimated == (block.start >= config.startup_needed)
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
        bank.describes_noise,
        *bank.baseline,
    )


def fed_directly(y: Array, config: EstimatorConfig, lsb: float) -> list[dict[str, dict[str, object]]]:
    """Estimates after each sample behind the start-up window, by axis, as an `estimate` record names them."""
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
    """Every number of these `estimate` records, to the bit."""
    for record, of_axes in zip(records, expected, strict=True):
        assert record["axes"].keys() == of_axes.keys()
        for axis, numbers in of_axes.items():
            assert record["axes"][axis] | numbers == record["axes"][axis], (record["seq"], axis)


def assert_same(found: Walked, expected: Walked) -> None:
    """To the bit."""
    for name in COLUMNS:
        np.testing.assert_array_equal(found.columns[name], expected.columns[name], err_msg=name)
    assert found[1:] == expected[1:]


def assert_close(found: Walked, expected: Walked, tolerance: float = 1e-9) -> None:
    """To the rounding of the start-up window's mean."""
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
    assert found.describes_noise == expected.describes_noise
    for mine, others in ((found.lag1, expected.lag1), (found.nis, expected.nis)):
        for axis, value in others.items():
            ours = mine[axis]
            if value is None or not math.isfinite(value):
                assert ours is None
            else:
                assert ours is not None
                assert math.isclose(ours, value, rel_tol=1e-8, abs_tol=1e-9)
