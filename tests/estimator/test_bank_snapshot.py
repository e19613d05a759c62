"""Tests of snapshots of a bank of filters. From a valid snapshot, a bank continues as before in every bit,
and all other snapshots are refused with a reason.
"""

import math
import struct
import zlib

import msgspec
import numpy as np
import pytest
from fltea.estimator.bank import Bank
from fltea.estimator.engine import instruction_sets
from fltea.estimator.filter_model import FilterModel
from fltea.estimator.snapshot import OnlineState
from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.bank_support import AXES, COLUMNS, H


def configured(**changes: object) -> EstimatorConfig:
    return EstimatorConfig(**({"startup": 50, "window": 40} | changes))  # type: ignore[arg-type]


CONFIG = configured()


def noise(n: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).standard_normal((n, 3)) * 0.153 + 0.7


def saved(config: EstimatorConfig = CONFIG, samples: int = 400, seed: int = 0) -> tuple[Bank, OnlineState]:
    bank, y = Bank(AXES, config, H, None), noise(samples, seed)
    bank.run(y[: bank.startup_remaining])
    bank.run(y[config.startup_needed :])
    state = bank.save()
    assert state is not None
    assert msgspec.json.decode(msgspec.json.encode(state), type=OnlineState) == state
    return bank, state


def resumed(state: OnlineState, config: EstimatorConfig = CONFIG) -> Bank:
    return Bank(AXES, config, H, None, state)


CONFIGS = [
    {},
    {"variant": "triple", "guard": "off"},
    {"variant": "triple", "guard": "faithful"},
    {"memory": "direct"},
    {"memory": "direct", "variant": "triple", "guard": "off"},
    {"window": 0},
    {"window": 3000},
    {"window": 10},
    {"bias": 0.7, "R": 0.02},
]


@pytest.mark.parametrize("changes", CONFIGS, ids=str)
@pytest.mark.parametrize("samples", [53, 400, 1100])
def test_goes_on_to_the_bit(changes: dict[str, object], samples: int) -> None:
    config = configured(**changes)
    bank, state = saved(config, samples)
    other = resumed(state, config)
    assert (other.baseline, other.startup_remaining, other.restarts) == (bank.baseline, 0, bank.restarts)
    assert other.save() == state
    y = noise(700, 1)
    for one in (bank, other):
        one.on_missing(3)
    a, b = bank.run(y), other.run(y)
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)
    assert bank.save() == other.save()


@pytest.mark.parametrize("name", instruction_sets())
def test_a_snapshot_goes_on_with_its_own_instruction_set(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("fltea.estimator.bank.instruction_sets", lambda: [name])
        bank, state = saved()
    other, y = resumed(state), noise(200, 1)
    assert other.save().instruction_set == name
    np.testing.assert_array_equal(other.run(y).x, bank.run(y).x)


def test_what_the_supervisors_have_seen_goes_on() -> None:
    """The estimates of an axis in violent motion are invalid, and stay invalid after a restart of the
    program.
    """
    bank = Bank(AXES, CONFIG, H, None)
    bank.run(noise(50))
    y = noise(200, 1)
    y[:, 1] += 30 * np.random.default_rng(1).choice([-1, 1], 200)
    assert not bank.run(y).valid[-1, 1]
    state = bank.save()
    assert state is not None
    assert not resumed(state).run(noise(1)).valid[0, 1]
    forgotten = msgspec.structs.replace(state, supervisors=None)
    assert resumed(forgotten).run(noise(1)).valid[0, 1]


def test_nothing_is_kept_of_a_start_up_window_or_with_a_constant_axis() -> None:
    bank = Bank(AXES, CONFIG, H, None)
    assert bank.save() is None
    y = noise(60)
    y[:, 2] = 1.0
    bank.run(y[:50])
    bank.run(y[50:])
    assert bank.save() is None


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"axes": ("gyro_x", "gyro_y")}, "axes gyro_x, gyro_y"),
        ({"bias_dps": (0.0,)}, "bias_dps has 1 numbers for 3 axes"),
        ({"R": ()}, "R has 0 numbers for 3 axes"),
        ({"bias_dps": (0.0, 1e308, 0.0)}, r"bias of gyro_y is impossible \(1e\+308\)"),
        ({"bias_dps": (math.nan, 0.0, 0.0)}, "bias of gyro_x"),
        ({"R": (0.02, 0.02, 0.0)}, "R of gyro_z is no variance"),
        ({"R": (0.02, -1.0, 0.02)}, "R of gyro_y is no variance"),
        ({"R": (math.inf, 0.02, 0.02)}, "R of gyro_x is no variance"),
        ({"R": (0.5, 0.5, 0.5)}, "other settings"),
        ({"restarts": {"gyro_x": -1}}, "-1 restarts of gyro_x"),
        ({"restarts": {"gyro_x": 1 << 60}}, "restarts of gyro_x"),
        ({"restarts": {"mag_x": 0}}, "restarts of 'mag_x'"),
        ({"engine": b""}, "damaged"),
        ({"checksum": -1}, "damaged"),
        ({"instruction_set": "zz"}, r"not usable here; usable: .*baseline"),
        ({"whiteness": b""}, "innovations"),
        ({"whiteness": b"\xff" * 8}, "innovations"),
        ({"whiteness": bytes(3 * 8 * 25)}, "innovations"),
        (
            {"filter_models": {"gyro_x": FilterModel(0.5, 0.1, 0.4, 0.1, -1.0, 0.1)}},
            "the filters of gyro_x cannot continue with",
        ),
        (
            {"tuned": ("gyro_x",), "filter_models": {"gyro_x": FilterModel(2.5, 0, 0, 0, 0, 0)}},
            "the filters of gyro_x cannot continue",
        ),
        ({"supervisors": b""}, "supervisors"),
        ({"supervisors": b"\xff" * 84}, "supervisors"),
        ({"supervisors": bytes(27) + b"\1" + bytes(56)}, "supervisors"),
    ],
    ids=str,
)
def test_what_is_not_wholly_sound_is_refused_with_the_reason(changes: dict[str, object], reason: str) -> None:
    _, state = saved()
    with pytest.raises(ValueError, match=reason):
        resumed(msgspec.structs.replace(state, **changes))


def with_engine(state: OnlineState, engine: bytes) -> OnlineState:
    """Replace the bytes of the engine (the native filters) in a snapshot, with a correct checksum."""
    return msgspec.structs.replace(state, engine=engine, checksum=zlib.crc32(engine))


@pytest.mark.parametrize("changes", CONFIGS[:4], ids=str)
@given(data=st.data(), value=st.sampled_from([math.nan, math.inf, -math.inf]))
def test_a_single_number_that_is_not_finite_is_refused_or_does_not_matter(
    changes: dict[str, object], data: st.DataObject, value: float
) -> None:
    """One number in a snapshot is replaced. Either the snapshot is refused, or its bank continues exactly as
    the original does: the number is then in an unused table, or in the unused room for further axes.
    """
    config = configured(**changes)
    _bank, state = saved(config)
    native = bytearray(state.engine)
    place = data.draw(st.integers(0, len(native) // 8 - 1)) * 8
    struct.pack_into("<d", native, place, value)
    try:
        found = resumed(with_engine(state, bytes(native)), config).run(noise(60, 1))
    except ValueError as error:
        assert "cannot come from an engine" in str(error)  # noqa: PT017
    else:
        expected = resumed(state, config).run(noise(60, 1))
        for name in COLUMNS:
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


@given(data=st.data())
def test_bytes_that_somebody_made_end_in_a_reason_or_in_estimates(data: st.DataObject) -> None:
    """Arbitrary bytes in a snapshot lead to a ValueError, or to a bank that works and is soon valid."""
    _, state = saved()
    native = bytearray(state.engine)
    parts = {
        "engine": native,
        "supervisors": bytearray(state.supervisors or b""),
    }
    part = parts[data.draw(st.sampled_from(sorted(parts)))]
    for place, value in data.draw(
        st.dictionaries(st.integers(0, len(part) - 1), st.integers(0, 255), max_size=8)
    ).items():
        part[place] = value
    made = with_engine(state, bytes(native))
    made = msgspec.structs.replace(made, supervisors=bytes(parts["supervisors"]))
    try:
        bank = resumed(made)
    except ValueError:
        return
    bank.run(noise(400, 2))
    assert bank.run(noise(400, 3)).valid[-100:].all()


@settings(max_examples=200)
@given(position=st.integers(0, 10**9), flip=st.integers(1, 255))
def test_damaged_bytes_are_refused(position: int, flip: int) -> None:
    _, state = saved()
    data = bytearray(state.engine)
    data[position % len(data)] ^= flip
    with pytest.raises(ValueError, match="damaged"):
        resumed(msgspec.structs.replace(state, engine=bytes(data)))


def test_cut_and_longer_engines_and_those_of_other_settings_are_refused() -> None:
    _, state = saved()
    for engine in (b"", state.engine[:-1], state.engine[:-8], state.engine + b"\0"):
        with pytest.raises(ValueError, match="cannot come from an engine"):
            resumed(with_engine(state, engine))
    with pytest.raises(ValueError, match="other settings"):
        resumed(state, configured(guard="faithful"))
    with pytest.raises(ValueError, match="other settings"):
        resumed(state, configured(window=39))
