"""Tests of the paper's algorithm in several interpretations, since the paper leaves some choices open."""

import json
from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest
from fltea.lab.reproduce import open_choices, paper, readings
from fltea.lab.reproduce.readings import Reading
from fltea.lab.reproduce.runs import Options, estimate
from fltea.lab.reproduce.scenarios import Data, SawTooth, example

SEEDS = [0, 3, 8]


@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_default_reading_is_the_engines(number: int) -> None:
    scenario = example(number, SawTooth(), 250)
    data = scenario.make(SEEDS)
    engine = estimate(scenario, data, 4000, Options())
    ours = readings.run(scenario.filters, Reading(), data)
    for mine, other in ((ours.x, engine.x), (ours.f, engine.f), (ours.alpha, engine.alpha)):
        assert mine == pytest.approx(other, rel=1e-8, abs=1e-10)


def test_the_states_variance_is_that_of_the_guard_consistent() -> None:
    scenario = example(3, SawTooth(), 60)
    data = scenario.make(SEEDS)
    engine = estimate(scenario, data, 4000, Options(guard="consistent"))
    inside = engine.interventions.sum(axis=1) == 0
    assert inside.any()
    ours = readings.run(scenario.filters, Reading(state_variance=True), data)
    assert ours.alpha[:, inside] == pytest.approx(engine.alpha[:, inside], rel=1e-8, abs=1e-10)
    assert ours.f[:, inside] == pytest.approx(engine.f[:, inside], rel=1e-8, abs=1e-10)


def by_hand(kappa: float, first: int, y: float, u: float) -> tuple[float, float, float, float]:
    """Return the order, the variance of the order, the parameter and the variance of the parameter, after one
    sample of example 1.

    These are computed by the formulas in section 5.1 of the paper.
    """
    h, R, x0 = 1e-3, 1e-3, 0.4

    def updated(mean: float, P: float, model: Callable[[float], float]) -> tuple[float, float]:
        root = np.sqrt((1 + kappa) * P)
        points = [mean, mean + root, mean - root]
        Wm = [kappa / (1 + kappa)] + [1 / (2 * (1 + kappa))] * 2
        Wc = [Wm[0] + 2, *Wm[1:]]
        Y = [model(point) for point in points]
        y_mean = sum(w * Yi for w, Yi in zip(Wm, Y, strict=True))
        Pyy = sum(Wc[i] * (Y[i] - y_mean) ** 2 for i in range(first, 3)) + R
        Pay = sum(Wc[i] * (points[i] - mean) * (Y[i] - y_mean) for i in range(first, 3))
        K = Pay / Pyy
        return mean + K * (y - y_mean), P - K * Pyy * K

    order, order_P = updated(1.0, 0.05 + 0.005, lambda a: h**a * u + a * x0)
    f, f_P = updated(0.0, 0.001 + 0.01, lambda w: h**order * (w * x0 + u) + order * x0)
    return order, f, order_P, f_P


@pytest.mark.parametrize("kappa", [2.0, 0.0, 0.7])
@pytest.mark.parametrize("first", [0, 1])
def test_one_step_is_the_printed_one(kappa: float, first: Literal[0, 1]) -> None:
    step = readings._Step(example(1, SawTooth()).filters, Reading(kappa=kappa, sums_from=first), 1)
    past = readings.Past(np.array([[0.4]]), np.array([[1.0]]))
    step(np.array([0.35]), np.array([0.9]), past)
    found = (step.order.mean[0], step.parameter.mean[0], step.order.P[0], step.parameter.P[0])
    assert found == pytest.approx(by_hand(kappa, first, 0.35, 0.9), rel=1e-10)


def test_kfw_first_takes_the_order_of_the_step_before() -> None:
    filters = example(1, SawTooth()).filters
    data = Data(np.array([[0.2]]), np.array([[1.0]]))
    after, before = (readings.run(filters, Reading(parameter_first=b), data) for b in (False, True))
    # The system multiplies f by the state before, which is x_0 = 0 at the first sample. So this sample says
    # nothing about f, and f stays 0. The filter of the order then gives the same result, whether the filter
    # of f runs before it or after it.
    assert after.f == before.f == 0
    assert after.alpha == before.alpha
    data = Data(np.array([[0.2], [0.3]]), np.array([[1.0], [1.0]]))
    after, before = (readings.run(filters, Reading(parameter_first=b), data) for b in (False, True))
    assert after.f[1, 0] != before.f[1, 0]
    assert after.alpha[1, 0] != before.alpha[1, 0]


def test_noise_outside_the_gain_is_added_to_the_state() -> None:
    inside, outside = (example(1, SawTooth(), 500, omega_outside=b).make(range(8)) for b in (False, True))
    assert inside.u is not None
    assert np.array_equal(inside.u, outside.u)
    # With x_0 = 0, the first state comes from the input u_0 and the noise ω_0 alone. It is h^α u_0 + ω_0 if
    # the noise is added outside of the gain h^α (h: sampling period, α: order), and else h^α (u_0 + ω_0).
    gain = paper.H**0.6
    added = outside.x[0] - gain * outside.u[0]
    assert gain * added == pytest.approx(inside.x[0] - gain * inside.u[0])
    assert 1e-4 < np.abs(added).mean() < 1e-2  # ω has the variance 1e-5, so its standard deviation is 3e-3


def test_every_choice_changes_what_it_says_and_is_told() -> None:
    rows = open_choices.compare(2, lambda name, steps: None, samples=80)
    assert [row["choice"] for row in rows] == [choice.name for choice in open_choices.CHOICES]
    as_chosen = rows[0]["examples"]
    for row in rows[1:]:
        assert row["examples"]["1"] != as_chosen["1"], row["choice"]
    json.dumps(rows, allow_nan=False)
    text = open_choices.document(rows)
    assert all(text.count(f"| {choice.name} |") == 2 for choice in open_choices.CHOICES)
    assert "nan" not in text


def test_progress_counts_every_run_once() -> None:
    done: list[int] = []
    choices = open_choices.CHOICES[:2]
    open_choices.compare(3, lambda name, steps: done.append(steps), choices, samples=30)
    assert sum(done) == open_choices.steps(3, choices) == 18


def test_seeds_near_the_printed_order_are_counted() -> None:
    choice = open_choices.Choice("as chosen")
    (row,) = open_choices.compare(2, lambda name, steps: None, [choice], samples=30)
    assert row["near_order"] == {"2": {"1": 0}, "3": {"2": 0, "3": 0}, "4": {"3": 0, "2": 0}}
    assert row["percentiles"]["3"]["2"]["order"] == 100
