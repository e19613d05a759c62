"""Tests `make validate ARGS=bias`. Its simulated noises, its copies of other programs' filters, and its plain
Kalman filter agree with theory.

All sections of this validation are run on a few samples.
"""

import ast
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.records.errors import UsageError
from hypothesis import given, settings
from hypothesis import strategies as st

from tools.validation import live_way, recursions
from tools.validation.bias import (
    errors,
    false_alarms,
    file_filter,
    headings,
    kalman,
    motion,
    noises,
    peers,
    run,
    steps,
)
from tools.validation.bias.noises import NOISES, SIGMA, TEN, H, Lane, drawn, lanes
from tools.validation.runner import Options
from tools.validation.tables import Table

COMPONENTS = {
    f"{name}, {k}": part
    for name, noise in NOISES.items()
    for k, part in enumerate((*noise.signal, *noise.rest))
    if not isinstance(part, noises.FractionalGaussian)
}


def cells(tables: list[Any]) -> list[Any]:
    """Check that each row of each table has as many cells as the table has headings. Return all rows of all
    tables.
    """
    for one in tables:
        assert isinstance(one, Table)
        assert one.rows
        assert {len(row) for row in one.rows} == {len(one.headings)}
    return [row for one in tables for row in one.rows]


@pytest.mark.parametrize("module", [noises, recursions, kalman])
def test_nothing_is_shared_with_the_filter(module: Any) -> None:
    tree = ast.parse(Path(module.__file__).read_text())
    found = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    ours = {name for name in found if name and name.startswith("fltea")}
    assert ours == {"fltea.records.arrays"}


@settings(max_examples=10, deadline=None)
@given(name=st.sampled_from(sorted(COMPONENTS)), cut=st.integers(1, 299))
def test_a_part_goes_on_where_it_stopped(name: str, cut: int) -> None:
    part, whole, cutted = COMPONENTS[name], np.random.default_rng(1), np.random.default_rng(1)
    first, state = part.draw(cutted, cut, None)
    second, _ = part.draw(cutted, 300 - cut, state)
    np.testing.assert_allclose(np.append(first, second), part.draw(whole, 300, None)[0], atol=1e-12)


@pytest.mark.parametrize("name", ["white", "EMA (.2)", "CIC", "DLPF"])
def test_filters_keep_the_density(name: str) -> None:
    """A filter in the sensor does not change the density of white noise at low frequencies. So a mean of 500
    samples has the variance σ²/500, where σ² is the variance of a sample before the filter.

    From 400 such means the standard deviation is estimated with a standard error of 3.5 %.
    """
    axis = Lane(name, np.random.default_rng(2))
    y, x = axis.take(200_000)
    means = (y - x).reshape(-1, 500).mean(axis=1)
    assert means.std() == pytest.approx(SIGMA / math.sqrt(500), rel=0.14)


def test_what_a_filter_or_fractional_noise_adds_is_or_is_no_bias() -> None:
    y, x = Lane("EMA (.2)", np.random.default_rng(3)).take(1_000)
    assert np.ptp(x) == 0
    assert np.ptp(y) > 0.1
    y, x = Lane("fGn .7", np.random.default_rng(3)).take(1 << 16)
    np.testing.assert_array_equal(x, y)
    means = (y - y.mean()).reshape(-1, 256).mean(axis=1)
    assert means.std() == pytest.approx(SIGMA * 256 ** (0.7 - 1), rel=0.2)


def test_relaxations_and_popcorn_are_as_they_are_called() -> None:
    part = noises.relaxation(0.05, 2.0)
    x = part.draw(np.random.default_rng(4), 1_000_000, None)[0]
    assert x.std() == pytest.approx(0.05, rel=0.06)
    assert float(np.corrcoef(x[200:], x[:-200])[0, 1]) == pytest.approx(math.exp(-1), abs=0.06)
    x = noises.Telegraph(0.05, 20.0).draw(np.random.default_rng(4), 1_000_000, None)[0]
    assert set(np.abs(x)) == {0.05}
    assert 400 < np.count_nonzero(np.diff(x)) < 600


def test_futures_have_the_past_in_common_and_nothing_else() -> None:
    axis = Lane("relaxations of 0.2 and 10 s", np.random.default_rng(5))
    before = axis.take(3_000)[1][-1]
    rng = np.random.default_rng(6)
    futures = np.array([axis.fork(rng).take(3_000)[1] for _ in range(200)])
    assert np.abs(futures[:, 0] - before).max() < 0.1
    assert float(np.corrcoef(futures[::2, -1], futures[1::2, -1])[0, 1]) == pytest.approx(0, abs=0.3)
    assert futures[:, -1].std() == pytest.approx(0.05 * math.sqrt(2), rel=0.2)
    assert axis.take(10)[1][0] == pytest.approx(before, abs=0.1)


def test_means_are_means() -> None:
    y = np.random.default_rng(7).normal(0, 1, (2_500, 3))
    np.testing.assert_allclose(peers.running_mean(y)[1_999], y[:2_000].mean(axis=0), atol=1e-12)
    short = peers.short_mean(y)
    np.testing.assert_allclose(short[99], y[:100].mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(short[2_100], y[1_101:2_101].mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(noises.mean_ahead(y, 100)[7], y[8:108].mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("peer", peers.PEERS)
def test_peers_find_an_offset(peer: str) -> None:
    axes = lanes("test", "white", range(3))
    y, x = drawn(axes, 12_000)
    bias = peers.PEERS[peer](y)
    assert bias.shape == y.shape
    assert np.abs(bias - x)[-1].max() < 0.015


def test_vqf_in_pieces_is_vqf(monkeypatch: pytest.MonkeyPatch) -> None:
    y = np.random.default_rng(8).normal(0.2, 0.1, (3_000, 3))
    whole = peers.vqf(y)
    monkeypatch.setattr(peers, "AT_ONCE", 700)
    np.testing.assert_array_equal(peers.vqf(y), whole)


@pytest.mark.parametrize("library", ["vqf", "imufusion"])
def test_a_missing_peer_is_told(library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(UsageError, match=rf"package {library}, which is not installed.*\[validation\]"):
        run.tasks(Options(3, quick=True))


def test_the_plain_filter_of_an_offset_is_the_mean() -> None:
    y = np.random.default_rng(9).normal(0.3, SIGMA, 1_000)
    plain = kalman.Plain(kalman.Model(SIGMA * math.sqrt(H), 0.0, (), 0.0, 1e4), H)
    plain.run(y)
    angle, std = plain.heading(6_000)
    assert angle == pytest.approx(60 * y.mean(), rel=1e-6)
    assert std == pytest.approx(
        math.hypot(60 * SIGMA / math.sqrt(1_000), SIGMA * math.sqrt(H * 60)), rel=1e-6
    )


@settings(max_examples=15, deadline=None)
@given(
    K=st.floats(0, 0.1),
    states=st.lists(st.tuples(st.floats(0.01, 0.2), st.floats(0.05, 20)), max_size=2),
    ahead=st.integers(1, 40),
    seed=st.integers(0, 99),
)
def test_the_plain_filter_is_the_best_linear_forecast(
    K: float, states: list[tuple[float, float]], ahead: int, seed: int
) -> None:
    """The recursive filter agrees with a forecast that is computed without recursion.

    The forecast without recursion is computed from the covariance of all samples.
    """
    n = 30
    k = np.arange(1, n + ahead + 1)
    covariance = 0.5**2 + K**2 * H * np.minimum.outer(k, k)
    for sigma, tau in states:
        covariance = covariance + sigma**2 * np.exp(-H * np.abs(k[:, None] - k) / tau)
    covariance += SIGMA**2 * np.eye(len(k))
    y = 0.2 + np.random.default_rng(seed).normal(0, 0.3, n)
    row = H * covariance[n:, :n].sum(axis=0) @ np.linalg.inv(covariance[:n, :n])
    angle = H * ahead * 0.2 + row @ (y - 0.2)
    variance = H**2 * covariance[n:, n:].sum() - H * row @ covariance[n:, :n].sum(axis=0)
    plain = kalman.Plain(kalman.Model(SIGMA * math.sqrt(H), K, tuple(states), 0.2, 0.5), H)
    plain.run(y)
    assert plain.heading(ahead) == pytest.approx((angle, math.sqrt(variance)), rel=1e-6)


def test_when_an_estimate_is_near() -> None:
    near = np.ones(1_000, dtype=bool)
    assert steps.settled_s(near) == 0
    near[300] = False
    near[50] = False
    assert steps.settled_s(near) == pytest.approx(0.51)
    near[100:1_000:150] = False
    assert steps.settled_s(near) is None


@pytest.mark.parametrize("noise", ["walk, 0.002 a sample", "DLPF"])
def test_the_live_way_does_not_depend_on_the_cuts(noise: str) -> None:
    y, _ = drawn(lanes("test", noise, range(3)), 1_200)
    whole, sensor = live_way.live_way(y, H), live_way.LiveSensor(3, H)
    pieces = [sensor.run(y[begin : begin + 333]) for begin in range(0, len(y), 333)]
    for name in live_way.Lived._fields:
        np.testing.assert_array_equal(
            np.concatenate([getattr(one, name) for one in pieces]), getattr(whole, name)
        )


def test_the_live_way_fits_as_the_record_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    times, fit = [], live_way.LiveSensor._fit

    def noted(sensor: live_way.LiveSensor) -> None:
        times.append(sensor._at)
        fit(sensor)

    monkeypatch.setattr(live_way.LiveSensor, "_fit", noted)
    sensor = live_way.LiveSensor(3, H)
    sensor.run(drawn(lanes("test", "walk, 0.002 a sample", range(3)), 4_000)[0])
    assert times[:12] == [*range(100, 1_101, 100), 1_210]
    assert times[12] == 1_210 + 121
    # every tracker has got a model from a fit; before the first fit, its model is called "walks"
    assert "walks" not in {figures.model for _, figures in sensor._tracks.stats()}


def test_sections_have_tasks_of_their_own() -> None:
    for quick in (False, True):
        keys = [one.key for one in run.tasks(Options(7, quick))]
        assert len(keys) == len(set(keys))
    for section in run.SECTIONS:
        found = run.tasks(Options(3, only=(f"{section}:",)))
        assert found
        assert all(one.name.startswith(section) for one in found)
    (task, *_) = run.tasks(Options(3, only=("false alarms",), hours=5))
    assert task.arguments == ("white", 5)


def test_steps_and_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = steps.stepped(1.0, 20, 0, 30)
    assert len(rows) == 3
    assert 7 < rows[0]["times_s"]["10 s mean"] < 9
    assert rows[0]["times_s"]["running mean"] is None
    ((name, axes, bound, *times),) = cells(steps.tables(rows))
    assert (name, axes, bound) == ("1 σ at 20 s", "3", "0.3")
    assert times[3] == "> 30, > 30"
    monkeypatch.setattr(motion, "REST_S", 20)
    rows = [row for way in motion.WAYS for row in motion.turned(way, 0)]
    assert [row["axis"] for row in rows] == ["x, y", "x, y", "z"] * 2
    for row in rows:
        assert row["within_s"] is None or 0 <= row["within_s"] <= motion.AFTER_S
    assert len(cells(motion.tables(rows))) == 4 + 2 * (1 + len(peers.PEERS)) + 2


def test_errors_and_false_alarms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(errors, "SPANS", {"10–30 s": (1_000, 3_000)})
    rows = errors.of_noise("white", 0)
    assert rows[0]["squares"]["running mean"] < rows[0]["squares"]["10 s mean"] < 0.01**2
    assert len(cells(errors.tables(rows))) == 2
    rows = false_alarms.count("white", 0.01)
    ((noise, hours, *_),) = cells(false_alarms.tables(rows))
    assert (noise, hours) == ("white", "0.03")
    assert false_alarms.tables([rows[0] | {"events": 3}])[0].rows[0][2:4] == ("3", "1.7e+04")


@pytest.mark.slow
def test_headings_and_the_filter_from_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(headings, "REST", 6_000)
    headings.best_stds.cache_clear()
    rows = [row for noise in ("white", "popcorn") for row in headings.forecast(noise, 0, 20)]
    headings.best_stds.cache_clear()
    assert rows[0]["times"][0]["best"] == pytest.approx(
        math.hypot(10 * SIGMA / 6_000**0.5, SIGMA * 0.1 * 10**0.5), rel=1e-3
    )
    assert rows[0]["times"][0]["std"] == pytest.approx(rows[0]["times"][0]["best"], rel=0.2)
    assert all("(" in cell for cell in cells(headings.tables(rows))[1][4:7])
    monkeypatch.setattr(file_filter, "REST", 6_000)
    rows = file_filter.navigate("white", 0, 5)
    assert [row["model"] for row in rows] == ["white"] * 3
    assert all(0.01 < one < 12 for row in rows for one in row["squares"][file_filter.WAYS[1]])
    assert len(cells(file_filter.tables(rows))) == 2


def test_the_filter_of_a_file() -> None:
    state = {"sigma": {"value": 0.1, "low": 0.0}, "tau_s": {"value": 2.0}}
    beside = {"N": {"value": 0.01}, "K": {"value": None}, "gauss_markov": [state]}
    assert file_filter.model_of(beside) == (0.01, 0.0, ((0.1, 2.0),), 0.0, file_filter.UNKNOWN)
    own = {
        "N": 0.02,
        "K": 0.001,
        "gauss_markov": [{"sigma": 0.1, "tau_s": 2.0}],
        "bias": 0.3,
        "bias_std": 0.01,
    }
    assert file_filter.model_of(beside | {"filter": own}) == (0.02, 0.001, ((0.1, 2.0),), 0.3, 0.01)
    assert file_filter.model_of(beside | {"N": {"value": None}}) is None


def test_the_ten_noises_are_ten() -> None:
    assert len(TEN) == 10
    assert set(noises.MODELLED) < set(TEN)
