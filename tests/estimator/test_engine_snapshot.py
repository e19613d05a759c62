"""Snapshots and refusals of the engine: what comes back, and what must not."""

import struct
import zlib

import numpy as np
import pytest
from engine_cases import GYROSCOPE, run, same, white, with_
from fltea.estimator.engine import (
    Engine,
    EngineSettings,
    JointTuning,
    OrderTuning,
    ParameterTuning,
    StateTuning,
    instruction_sets,
)
from hypothesis import given, settings
from hypothesis import strategies as st


def saved() -> bytes:
    engine = Engine(3, with_(GYROSCOPE, window=20))
    engine.run(white(30, 3, 1))
    return engine.save()


def resealed(body: bytes) -> bytes:
    return body + struct.pack("<I", zlib.crc32(body))


@pytest.mark.parametrize("instruction_set", instruction_sets())
@pytest.mark.parametrize("memory", ["direct", "compressed"])
def test_a_restored_engine_goes_on_to_the_bit(memory: str, instruction_set: str) -> None:
    y = white(400, 11, 2)
    R = np.linspace(0.01, 0.04, 11)
    tuning = with_(GYROSCOPE, memory=memory, window=150, guard="faithful", state=StateTuning(R=R))
    engine = Engine(11, tuning, instruction_set=instruction_set)
    engine.run(y[:200])
    data = engine.save()
    restored = Engine.restore(data)
    assert restored.instruction_set == instruction_set
    assert restored.save() == data
    assert same(restored.run(y[200:]), engine.run(y[200:]))


def test_settings_come_back_with_it() -> None:
    tuning = with_(GYROSCOPE, h=[0.01, 0.02], variant="joint", guard="consistent", gate=3.0, window=7)
    restored = Engine.restore(Engine(2, tuning).save())
    assert (restored.lanes, restored.settings.variant, restored.settings.guard) == (2, "joint", "consistent")
    assert (restored.settings.memory, restored.settings.window) == ("direct", 7)
    assert np.array_equal(restored.settings.table(2), tuning.table(2))
    assert Engine.restore(Engine(2, tuning).save(), tuning).settings is tuning


@settings(max_examples=200)
@given(position=st.integers(0, 10**9), flip=st.integers(1, 255))
def test_damaged_bytes_are_refused(position: int, flip: int) -> None:
    data = bytearray(saved())
    data[position % len(data)] ^= flip
    with pytest.raises(ValueError, match=r"snapshot"):
        Engine.restore(bytes(data))


@given(st.binary(max_size=200))
def test_foreign_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="not a snapshot"):
        Engine.restore(data)


def test_cut_and_longer_bytes_are_refused() -> None:
    data = saved()
    for wrong in (data[:-1], data[: len(data) // 2], data + b"\0"):
        with pytest.raises(ValueError, match=r"should have \d+ bytes"):
            Engine.restore(wrong)


def test_another_version_other_settings_and_a_wrong_state_are_refused() -> None:
    data = saved()
    with pytest.raises(ValueError, match="version 2, this fltea reads version 1"):
        Engine.restore(resealed(data[:8] + struct.pack("<I", 2) + data[12:-4]))
    with pytest.raises(ValueError, match="other settings"):
        Engine.restore(data, with_(GYROSCOPE, window=20, guard="faithful"))
    with pytest.raises(ValueError, match="other settings"):
        Engine.restore(data, with_(GYROSCOPE, window=20, state=StateTuning(R=0.02)))
    foreign = data[:-4].replace(b'"lanes": 3', b'"lanes": 9')
    with pytest.raises(ValueError, match=r"not a snapshot|cannot reshape"):
        Engine.restore(resealed(foreign))
    other_set = data[:-4].replace(
        f'"instruction_set": "{instruction_sets()[0]}"'.encode(),
        f'"instruction_set": "{"z" * len(instruction_sets()[0])}"'.encode(),
    )
    with pytest.raises(ValueError, match=r"not usable here; usable: .*baseline"):
        Engine.restore(resealed(other_set))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"h": 0}, "h must be"),
        ({"h": float("nan")}, "h must be"),
        ({"h": [0.01, 0.01, 0.01]}, r"h must .* 2 lanes, got shape \(3,\)"),
        ({"window": 0}, "window must be at least 1"),
        ({"window": 1 << 40}, "window must be .* at most"),
        ({"window": None, "memory": "direct"}, "unlimited window"),
        ({"memory": "some"}, "memory must be one of direct, compressed"),
        ({"variant": "double"}, "variant must be one of"),
        ({"guard": "on"}, "guard must be one of"),
        ({"accuracy": 2}, "accuracy must be"),
        ({"gate": 0.5}, "gate must be"),
        ({"state": StateTuning(R=0)}, "state.R must be a variance, at least"),
        ({"state": StateTuning(R=[0.1, -0.1])}, "state.R must be"),
        ({"state": StateTuning(P0=-1)}, "state.P0 must be a variance"),
        ({"state": StateTuning(Q=float("inf"))}, "state.Q must be finite"),
        ({"state": StateTuning(x0=1e101)}, "state.x0 must be finite"),
        ({"order": OrderTuning(delta=1.1)}, "order.delta must be in"),
        ({"order": OrderTuning(R=0)}, "order.R must be"),
        ({"parameter": ParameterTuning(Q0=-1)}, "parameter.Q0 must be"),
        ({"order": OrderTuning(alpha0=2.1), "guard": "faithful"}, "order.alpha0 must be within the bounds"),
        ({"joint": JointTuning(beta0=1.1), "variant": "joint", "guard": "faithful"}, "joint.beta0 must be"),
        ({"joint": JointTuning(P0=-1), "variant": "joint"}, "joint.P0 must be"),
    ],
    ids=str,
)
def test_settings_that_no_filter_can_work_with_are_named(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Engine(2, with_(GYROSCOPE, **changes))


def test_calls_of_a_wrong_shape_are_refused() -> None:
    engine = Engine(2, GYROSCOPE)
    for wrong in ([[1.0]], [1.0, 2.0], [[1.0, 2.0, 3.0]]):
        with pytest.raises(ValueError, match="y must have 2 lanes"):
            engine.run(wrong)
    with pytest.raises(ValueError, match=r"u must have y's shape \(1, 2\), got \(2, 2\)"):
        engine.run([[1.0, 2.0]], [[0.0, 0.0]] * 2)
    with pytest.raises(ValueError, match="missing must have y's shape"):
        engine.step([1.0, 2.0], missing=[True])
    with pytest.raises(ValueError, match=r"mask must have shape \(2,\)"):
        engine.reset([True])
    with pytest.raises(ValueError, match="at least one lane"):
        Engine(0, GYROSCOPE)
    with pytest.raises(ValueError, match="'sse9' is not usable here"):
        Engine(1, GYROSCOPE, instruction_set="sse9")
    assert engine.run(np.empty((0, 2))).alpha.shape == (0, 2)


def test_settings_for_each_lane_are_those_of_lanes_of_their_own() -> None:
    y = white(60, 3, 3)
    each = EngineSettings(
        h=[0.01, 0.02, 0.03],
        memory="direct",
        state=StateTuning(P0=[0.1, 0.2, 0.3], Q=[0.1, 0.2, 0.1], x0=[0, 1, 2], R=[0.01, 0.02, 0.03]),
        order=OrderTuning(alpha0=[0.5, 1, 1.5], P0=[0.1, 0.2, 0.1], R=[0.1, 0.2, 0.3]),
        parameter=ParameterTuning(f0=[-1, -2, 0], delta=[0, 0.5, 1]),
    )
    together = run(each, y)
    table = each.table(3)
    for k in range(3):
        alone = EngineSettings(
            h=each.h[k],  # type: ignore[index]
            memory="direct",
            state=StateTuning(*table[k, [2, 3, 1, 4]]),
            order=OrderTuning(*table[k, [6, 7, 5, 8, 9]]),
            parameter=ParameterTuning(*table[k, [11, 12, 10, 13, 14]]),
        )
        assert np.array_equal(run(alone, y[:, k : k + 1]).f[:, 0], together.f[:, k])
