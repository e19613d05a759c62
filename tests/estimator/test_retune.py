"""Tests that filters keep all of their memory when their Q and R change while they run."""

import math
from typing import Literal

import msgspec
import numpy as np
import pytest
from fltea.estimator.bank import Bank, Variances
from fltea.estimator.engine import Engine, instruction_sets
from fltea.estimator.filter_model import FilterModel
from fltea.estimator.lane_settings import LaneSettings
from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig

from tests.rig.bank_support import AXES, COLUMNS, H
from tests.rig.engine_cases import GYROSCOPE, reference_run, run_changing, same, white, with_

CHANGES = {300: (0.01, 0.02), 301: (0.3, 0.05), 900: (0.0, 0.0235)}
CONFIG = EstimatorConfig(startup=50, window=40)


@pytest.mark.parametrize("instruction_set", instruction_sets())
@pytest.mark.parametrize("memory", ["direct", "compressed"])
def test_equals_the_reference_whose_q_and_r_change(memory: str, instruction_set: str) -> None:
    y, u = white(1200, 1, 5)[:, 0], np.zeros(1200)
    expected = reference_run(GYROSCOPE, y, u, u > 0, CHANGES)
    found = run_changing(with_(GYROSCOPE, memory=memory), y, u, CHANGES, instruction_set=instruction_set)
    size = np.maximum(np.abs(expected), np.sqrt(np.nanmean(expected**2, axis=0)))
    assert (np.abs(found - expected) / size).max() < (1e-10 if memory == "direct" else 1e-5)
    plain = reference_run(GYROSCOPE, y, u, u > 0)
    assert np.abs(plain - expected)[-1, 0] > 1e-3, "the change is seen"


SETTINGS = [
    GYROSCOPE,
    with_(GYROSCOPE, memory="compressed", guard="consistent", variant="joint"),
    with_(GYROSCOPE, memory="compressed", guard="faithful", window=0),
]


@pytest.mark.parametrize("settings", SETTINGS, ids=lambda s: f"{s.config.memory}, {s.config.variant}")
def test_lanes_whose_numbers_stay_do_not_notice(settings: LaneSettings) -> None:
    y, a, b = white(200, 5, 1), Engine(5, settings), Engine(5, settings)
    a.run(y), b.run(y)
    b.retune(settings)
    assert same(a.run(y), b.run(y))
    Q, R = np.full(5, settings.config.state.Q), np.full(5, settings.R)
    Q[3], R[3] = 0.003, 0.011
    b.retune(with_(settings, state__Q=Q, R=R))
    plain, changed = a.run(y), b.run(y)
    others = [0, 1, 2, 4]
    np.testing.assert_array_equal(plain.alpha[:, others], changed.alpha[:, others])
    assert (plain.x[:, 3] != changed.x[:, 3]).all()


def test_lanes_that_begin_again_have_the_new_numbers() -> None:
    y, engine = white(100, 2, 1), Engine(2, SETTINGS[1])
    engine.run(y)
    other = with_(SETTINGS[1], state__Q=0.003, R=0.011)
    engine.retune(other)
    engine.reset()
    assert same(engine.run(y), Engine(2, other).run(y))


@pytest.mark.parametrize(
    "changes", [{"window": 7}, {"memory": "direct"}, {"variant": "triple"}, {"guard": "off"}, {"accuracy": 3}]
)
def test_what_the_memory_is_made_for_cannot_change(changes: dict[str, object]) -> None:
    engine = Engine(1, SETTINGS[1])
    with pytest.raises(ValueError, match="cannot change"):
        engine.retune(with_(SETTINGS[1], **changes))


@pytest.mark.parametrize("changes", [{"R": 0.0}, {"state__Q": -1.0}, {"R": (0.1, 0.2)}])
def test_what_no_filter_can_work_with_changes_nothing(changes: dict[str, object]) -> None:
    y, a, b = white(50, 1, 1), Engine(1, SETTINGS[1]), Engine(1, SETTINGS[1])
    with pytest.raises(ValueError, match=r"(R|Q) must be"):
        b.retune(with_(SETTINGS[1], **changes))
    assert same(a.run(y), b.run(y))


# --- the filters of all axes (`Bank`) ---


def begun(samples: int = 400, variant: Literal["joint", "triple"] = "joint") -> tuple[Bank, Array]:
    y = np.random.default_rng(1).standard_normal((samples + 50, 3)) * 0.153 + 0.7
    bank = Bank(AXES, msgspec.structs.replace(CONFIG, variant=variant), H, None)
    bank.run(y[:50])
    return bank, y[50:]


def test_a_bank_goes_on_with_what_one_axis_was_told() -> None:
    a, y = begun()
    b, _ = begun()
    a.run(y), b.run(y)
    b.retune({"gyro_y": Variances(0.003, 0.011)})
    plain, changed = a.run(y), b.run(y)
    np.testing.assert_array_equal(plain.alpha[:, [0, 2]], changed.alpha[:, [0, 2]])
    assert (plain.x[:, 1] != changed.x[:, 1]).all()
    assert b.tuned == {"gyro_y"}
    assert b.variances["gyro_y"] == (0.003, 0.011)
    assert b.variances["gyro_x"] == a.variances["gyro_x"] == (CONFIG.state.Q, a.baseline.R[0])  # type: ignore[union-attr]


def test_a_saved_bank_goes_on_with_what_it_was_told() -> None:
    bank, y = begun()
    bank.run(y)
    bank.retune({"gyro_y": Variances(0.003, 0.011), "gyro_z": Variances(0.004, 0.012)}, {"gyro_z": BELIEF})
    state = bank.save()
    assert state is not None
    other = Bank(AXES, CONFIG, H, None, msgspec.convert(msgspec.to_builtins(state), type(state)))
    assert (other.variances, other.tuned) == (bank.variances, bank.tuned)
    assert other.filter_models == bank.filter_models == {"gyro_z": BELIEF}
    assert other.save() == state
    a, b = bank.run(y), other.run(y)
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@pytest.mark.parametrize(
    ("variances", "reason"),
    [
        ({"accel_x": Variances(0.1, 0.1)}, "accel_x is not estimated"),
        ({"gyro_x": Variances(-0.1, 0.1)}, "state.Q must be a number from 0"),
        ({"gyro_x": Variances(0.1, 0.0)}, "R must be "),
    ],
)
def test_a_bank_refuses_what_cannot_be(variances: dict[str, Variances], reason: str) -> None:
    bank, _ = begun()
    before = dict(bank.variances)
    with pytest.raises(ValueError, match=reason):
        bank.retune(variances)
    assert (bank.variances, bank.tuned) == (before, set())


def test_a_bank_in_its_start_up_window_cannot_be_told() -> None:
    with pytest.raises(ValueError, match="the start-up window is not full"):
        Bank(AXES, CONFIG, H, None).retune({})


BELIEF = FilterModel(0.7, 0.05, 0.6, 0.02, -2.5, 0.8)


@pytest.mark.parametrize("variant", ["joint", "triple"])
def test_an_axis_goes_on_with_the_order_that_belongs_to_its_variances(
    variant: Literal["joint", "triple"],
) -> None:
    """When Q and R of an axis change, its filters keep their state and their memory, but continue with α and
    f of the model fit. Here, the fit says that α and f are nearly certain.

    The other axes are not affected.
    """
    certain = BELIEF._replace(alpha_std=1e-6, F_std=1e-6, f_std=1e-6)
    (told, y), (plain, _) = begun(variant=variant), begun(variant=variant)
    a, b = told.run(y[:300]), plain.run(y[:300])
    told.retune({"gyro_y": Variances(0.003, 0.011)}, {"gyro_y": certain})
    plain.retune({"gyro_y": Variances(0.003, 0.011)})
    a, b = told.run(y[300:301]), plain.run(y[300:301])
    np.testing.assert_array_equal(a.alpha[:, [0, 2]], b.alpha[:, [0, 2]])
    np.testing.assert_allclose(
        [a.alpha[0, 1], a.f[0, 1]], [0.7, -2.5 if variant == "triple" else -0.1 / H**0.7], rtol=1e-2
    )
    assert abs(b.alpha[0, 1] - 0.7) > 0.05
    assert abs(a.x[0, 1] - b.x[0, 1]) < 0.05


def test_deviations_count_what_the_fit_leaves_open_and_how_far_the_filter_has_gone_from_it() -> None:
    bank, y = begun()
    bank.retune({"gyro_y": Variances(0.003, 0.011)}, {"gyro_y": BELIEF})
    other, _ = begun()
    other.retune({"gyro_y": Variances(0.003, 0.011)}, {"gyro_y": BELIEF})
    # `other` then forgets what the model fit says of α and f. So its standard deviations of α and f are those
    # of its filters alone.
    other.native.know([None] * 3)
    found, own = bank.run(y), other.run(y)
    for std, own_std, value, believed, open_ in (
        (found.alpha_std, own.alpha_std, own.alpha, 0.7, 0.05),
        (found.f_std, own.f_std, own.f, -2.5, 0.8),
    ):
        gone = value[:, 1] - believed
        np.testing.assert_array_equal(std[:, 1], np.sqrt(np.maximum(own_std[:, 1], open_) ** 2 + gone**2))
        np.testing.assert_array_equal(std[:, [0, 2]], own_std[:, [0, 2]])
    assert bank.found("gyro_y") == (own.alpha[-1, 1], own.alpha_std[-1, 1])
    bank.retune({"gyro_y": Variances(0.003, 0.011)})
    assert not bank.filter_models


@pytest.mark.parametrize(
    "filter_model",
    [
        BELIEF._replace(alpha=2.1),
        BELIEF._replace(alpha=-0.1),
        BELIEF._replace(F_std=-1.0),
        BELIEF._replace(f=math.inf),
        BELIEF._replace(alpha_std=math.nan),
    ],
)
def test_a_bank_refuses_a_belief_that_cannot_be(filter_model: FilterModel) -> None:
    bank, _ = begun()
    before = dict(bank.variances)
    for axis in ("gyro_x", "gyro_y"):
        with pytest.raises(ValueError, match="cannot continue with"):
            bank.retune({"gyro_x": Variances(0.1, 0.1)}, {axis: filter_model if axis == "gyro_x" else BELIEF})
    assert (bank.variances, bank.filter_models) == (before, {})


def test_a_constant_axis_cannot_be_told() -> None:
    y = np.random.default_rng(1).standard_normal((50, 3))
    y[:, 1] = 1.0
    bank = Bank(AXES, CONFIG, H, None)
    bank.run(y)
    with pytest.raises(ValueError, match="gyro_y is not estimated"):
        bank.retune({"gyro_y": Variances(0.1, 0.1)})
