"""Tests that the names declared for each kind of sensor (gyroscope, accelerometer) exist in records, settings
and units.
"""

import msgspec
import pytest
from fltea.records.block import Block
from fltea.records.quantity import factor
from fltea.records.records import Hello, Sample
from fltea.records.sensor_kind import ACCELEROMETER, GYROSCOPE, SENSOR_KINDS, SensorKind, kind_of
from fltea.settings.config import Config
from fltea.settings.estimator import EstimatorConfig
from fltea.stream.epoch import SAVED_FIELDS, Saved

kinds = pytest.mark.parametrize("kind", SENSOR_KINDS, ids=lambda kind: kind.name)


@kinds
def test_each_name_is_one_of_the_program(kind: SensorKind) -> None:
    assert kind.scale_field in Hello.__struct_fields__
    assert kind.samples_field in Sample.__struct_fields__
    assert hasattr(Block, kind.samples_field) or kind.samples_field in Block.__annotations__
    assert isinstance(getattr(Config(), kind.settings), EstimatorConfig)
    assert {field.format(kind.name) for field in SAVED_FIELDS} <= set(Saved.__struct_fields__)
    assert factor(kind.unit, kind.text_unit) == 1.0
    assert [kind_of(axis) for axis in kind.axes] == [kind] * 3


def test_all_saved_fields_belong_to_a_kind() -> None:
    named = {field.format(kind.name) for kind in SENSOR_KINDS for field in SAVED_FIELDS}
    assert named == {one.name for one in msgspec.structs.fields(Saved)}


def test_saved_state_is_given_to_its_sensor() -> None:
    saved = Saved(gyro_fit=b"a", accel_fit=b"b", gyro_track=b"c", accel_track=b"d")
    assert saved.of(GYROSCOPE) == (None, b"a", b"c")
    assert saved.of(ACCELEROMETER) == (None, b"b", b"d")
