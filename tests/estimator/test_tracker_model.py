"""Tests that a model has the same effect on a tracker if another thread has computed it."""

import threading
from collections.abc import Callable

import numpy as np
import pytest
from fltea.estimator.tracker import (
    MOST_TO_COME,
    EventKind,
    Remembered,
    Tracker,
    TrackerModel,
    TrackerRules,
    Tracks,
)
from fltea.noise.linear_system import System
from fltea.noise.parts import Relaxation, White
from fltea.noise.system import system
from fltea.records.arrays import Array

from tests.rig.tracker_support import SYSTEMS, H

RULES = TrackerRules(ahead=100, checked=(50, 500), largest_step=1.0)
WALKS = system([White(1.0), Relaxation(0.3, 5.0)], H, 100_000).with_offset(1e-6)
STAYS = WALKS._replace(Q=WALKS.Q * (np.arange(len(WALKS.a)) < len(WALKS.a) - 1))
MODELS: dict[str, tuple[System, System | None, float]] = {
    "white": (SYSTEMS["white"], None, 1.0),
    "order": (SYSTEMS["order"], None, 1.0),
    "rivals": (WALKS, STAYS, 0.3),
}


def noise(n: int, seed: int = 1) -> Array:
    """Return n samples of white noise of one axis, as an array (n, 1)."""
    return np.random.default_rng(seed).normal(size=(n, 1))


def after(tracker: Tracker) -> Tracks:
    """Return all outputs of a tracker for 3,000 further samples."""
    return tracker.run(noise(3000, seed=9))


def begun(samples: int) -> tuple[Tracker, Tracker, Remembered]:
    """Return two trackers that have processed the same samples, and the samples that one of the trackers
    remembers.
    """
    one, other = Tracker([None], RULES), Tracker([None], RULES)
    for tracker in (one, other):
        tracker.run(noise(samples))
    return one, other, one.remembered(0)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize(
    ("samples", "to_come"),
    [(0, 0), (0, 40), (10, 7), (700, 64), (2100, 33), (2500, MOST_TO_COME), (70_000, 0), (70_000, 200)],
)
def test_what_was_filtered_before_the_last_samples_is_the_same_to_the_bit(
    name: str, samples: int, to_come: int
) -> None:
    one, other, remembered = begun(samples)
    model, whole = (TrackerModel(RULES, *MODELS[name]) for _ in range(2))
    model.refilter(remembered, to_come)
    for tracker, own in ((one, model), (other, whole)):
        tracker.run(noise(to_come, seed=2))
        tracker.use_model(0, own)
    assert one.x(0)[0] == other.x(0)[0]
    np.testing.assert_array_equal(one.x(0)[1], other.x(0)[1])
    for column, expected in zip(after(one), after(other), strict=True):
        np.testing.assert_array_equal(column, expected)


def knocked(tracker: Tracker) -> None:
    """Give the tracker samples of a sensor that is moved, and check that it reports motion."""
    tracker.run(noise(100, seed=2) + 500 * np.sin(np.arange(100.0))[:, None])
    assert tracker.events[0].kind == EventKind.MOVES


def stepped(tracker: Tracker) -> None:
    """Give the tracker samples with a step of the bias, and check that it reports a step."""
    tracker.run(noise(100, seed=2) + 1.5)
    assert [event.kind for event in tracker.events] == [EventKind.STEP]


MEANWHILE: dict[str, Callable[[Tracker], object]] = {
    "fewer samples": lambda tracker: tracker.run(noise(99, seed=2)),
    "more samples": lambda tracker: tracker.run(noise(101, seed=2)),
    "motion": knocked,
    "a step": stepped,
    "a long gap": lambda tracker: (tracker.skip(200_000), tracker.run(noise(100, seed=2))),
}


@pytest.mark.parametrize("name", MEANWHILE)
def test_where_more_has_happened_the_tracker_filters_all(name: str) -> None:
    one, other, remembered = begun(5000)
    model, whole = (TrackerModel(RULES, *MODELS["rivals"]) for _ in range(2))
    model.refilter(remembered, 100)
    for tracker, own in ((one, model), (other, whole)):
        MEANWHILE[name](tracker)
        tracker.use_model(0, own)
    assert one.save() == other.save()


def test_lost_samples_are_samples_of_which_nothing_is_known() -> None:
    one, other, remembered = begun(5000)
    model, whole = (TrackerModel(RULES, *MODELS["white"]) for _ in range(2))
    model.refilter(remembered, 100)
    for tracker, own in ((one, model), (other, whole)):
        tracker.run(noise(70, seed=2))
        tracker.skip(30)
        tracker.use_model(0, own)
    for column, expected in zip(after(one), after(other), strict=True):
        np.testing.assert_array_equal(column, expected)


def test_a_model_is_taken_by_one_tracker_after_the_other() -> None:
    one, other, remembered = begun(5000)
    model = TrackerModel(RULES, *MODELS["rivals"])
    model.refilter(remembered, 0)
    one.use_model(0, model)
    other.use_model(0, model)
    alone = after(other)
    for column, expected in zip(after(one), alone, strict=True):
        np.testing.assert_array_equal(column, expected)


def test_models_are_made_in_threads_while_the_walk_goes_on() -> None:
    lanes = len(MODELS)
    y = np.random.default_rng(3).normal(size=(20_000, lanes))
    walks, alone = Tracker([None] * lanes, RULES), Tracker([None] * lanes, RULES)
    found, expected = list[Tracks](), list[Tracks]()
    for at in range(0, len(y), 2000):
        before, behind = y[at : at + 1900], y[at + 1900 : at + 2000]
        walks.run(before)
        models = list[TrackerModel | None]([None] * lanes)

        def make(lane: int, remembered: Remembered, models: list[TrackerModel | None] = models) -> None:
            models[lane] = made = TrackerModel(RULES, *list(MODELS.values())[lane])
            made.refilter(remembered, 100)

        threads = [threading.Thread(target=make, args=(k, walks.remembered(k))) for k in range(lanes)]
        for thread in threads:
            thread.start()
        for row in behind:
            found.append(walks.run(row[None]))
        alone.run(before)
        expected += [alone.run(row[None]) for row in behind]
        for lane, thread in enumerate(threads):
            thread.join()
            made = models[lane]
            assert made is not None
            walks.use_model(lane, made)
            alone.set(lane, *list(MODELS.values())[lane])
    for one, other in zip(found, expected, strict=True):
        for column, right in zip(one, other, strict=True):
            np.testing.assert_array_equal(column, right)


@pytest.mark.parametrize("to_come", [-1, MOST_TO_COME + 1])
def test_nothing_is_filtered_before_too_many_samples(to_come: int) -> None:
    with pytest.raises(ValueError, match="to_come"):
        TrackerModel(RULES, *MODELS["white"]).refilter(Tracker([None]).remembered(0), to_come)


def test_no_model_of_what_no_filter_can_work_with() -> None:
    white = SYSTEMS["white"]
    with pytest.raises(ValueError, match="cannot use this noise model"):
        TrackerModel(RULES, white._replace(R=0.0))
    with pytest.raises(ValueError, match="differ in size"):
        TrackerModel(RULES, white, WALKS, 0.5)
    with pytest.raises(ValueError, match="a weight is not a number"):
        TrackerModel(RULES, white, white, 1.5)
