"""Steps of the bias and motions are stored in a recording as channels of their own. `info` counts them, and
`export` writes them as tables.
"""

import csv
from pathlib import Path

import msgspec
import numpy as np
import pytest
from fltea.archive.export import export
from fltea.archive.info import Summary, as_text, summarise
from fltea.records.errors import UsageError
from fltea.records.records import AnyRecord, Motion, Sample, Step
from fltea.settings.outputs import Recorded
from fltea.sources.replay import ReplaySource
from msgspec.structs import replace

from tests.rig.blocks import of
from tests.rig.example_records import MOVES, RESTS, STEP
from tests.rig.mcap_support import files, messages, record, replay, transport

DOWN = replace(STEP, axis="gyro_z", size=-0.2, host_ns=9 * 10**9)
CHANGES = [STEP, DOWN, MOVES, RESTS, replace(MOVES, host_ns=12 * 10**9)]


def recorded(folder: Path, *changes: Step | Motion, **settings: object) -> list[AnyRecord]:
    """Write the records of a device at rest, then the steps and motions `changes`, to a recording. Return all
    records.
    """
    live, sink = record(folder, transport(samples=60), end=False, **settings)
    for one in changes:
        sink.write(one)
    sink.close()
    return [*live, *changes]


def test_they_are_channels_with_schemas(tmp_path: Path) -> None:
    live = recorded(tmp_path, *CHANGES)
    found = [
        (topic, message)
        for topic, message in messages(*files(tmp_path))
        if topic.endswith(("/step", "/motion"))
    ]
    assert {topic for topic, _ in found} == {"/due/step", "/due/motion"}
    # messages leave out fields that are null
    null = {"/due/step": {}, "/due/motion": {"samples": None, "largest": None}}
    said = [null[topic] | msgspec.json.decode(message.data) for topic, message in found]
    again = [msgspec.convert(one, Step | Motion) for one in said]
    # the records are sorted by time, since readers of MCAP return messages in this order
    wanted = sorted(of(Step | Motion, live), key=lambda one: one.host_ns)
    assert again == wanted
    assert [message.log_time for _, message in found] == [one.host_ns for one in wanted]


def test_a_sum_counts_steps_and_motions(tmp_path: Path) -> None:
    live = recorded(tmp_path, *CHANGES)
    found = summarise(files(tmp_path), 100)
    assert found.steps == len(of(Step, live))
    assert found.motions == sum(one.begins for one in of(Motion, live))
    assert f"{found.steps} steps; the sensor moved {found.motions} times" in as_text(found)
    assert msgspec.json.decode(msgspec.json.encode(found), type=Summary) == found


@pytest.mark.parametrize(("channels", "steps"), [(("step", "motion"), 0), (("sample",), None)])
def test_none_is_something_else_than_not_recorded(
    channels: tuple[Recorded, ...], steps: int | None, tmp_path: Path
) -> None:
    recorded(tmp_path, channels=channels)
    found = summarise(files(tmp_path), 100)
    assert found.steps == found.motions == steps
    assert ("0 steps" in as_text(found)) == (steps == 0)


def test_a_damaged_one_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "fltea.sinks.record.encode_message", lambda one: b'{"class":"step"' + b"[" * isinstance(one, Step)
    )
    recorded(tmp_path, STEP, channels=("step",))
    assert summarise(files(tmp_path), 100).steps == 0


def test_a_printed_run_is_counted_and_replayed_as_without_them(tmp_path: Path) -> None:
    live = [one for one in recorded(tmp_path / "rec") if not isinstance(one, Step | Motion)]
    for name, records in (("with.ndjson", [*live[:40], *CHANGES, *live[40:]]), ("without.ndjson", live)):
        (tmp_path / name).write_bytes(b"".join(msgspec.json.encode(one) + b"\n" for one in records))
    found = summarise([tmp_path / "with.ndjson"], 100)
    assert (found.steps, found.motions) == (2, 2)
    other = summarise([tmp_path / "without.ndjson"], 100)
    assert (other.steps, other.motions) == (None, None)
    assert ReplaySource(tmp_path / "with.ndjson").changes.steps == 2
    samples = [of(Sample, replay(tmp_path / name)) for name in ("with.ndjson", "without.ndjson")]
    assert len(samples[0]) == len(of(Sample, live))
    assert samples[0] == samples[1]


def exported(folder: Path, what: str) -> tuple[list[dict[str, str]], dict[str, np.ndarray]]:
    for name in ("out.csv", "out.npz"):
        export([folder / "rec"], folder / name, what, 100)  # type: ignore[arg-type]
    with (folder / "out.csv").open(newline="", encoding="utf-8") as file, np.load(folder / "out.npz") as data:
        return list(csv.DictReader(file)), dict(data)


def test_steps_are_a_table(tmp_path: Path) -> None:
    steps = of(Step, recorded(tmp_path / "rec", *CHANGES))
    rows, data = exported(tmp_path, "steps")
    names = ["epoch", "seq", "device_us", "host_ns", "axis", "unit", "size", "size_std", "found_after"]
    assert [*rows[0]] == [*data] == names
    for i, step in enumerate(steps):
        wanted = [getattr(step, name) for name in names]
        assert [*rows[i].values()] == [str(value) for value in wanted]
        assert [data[name][i] for name in names] == wanted


def test_motions_are_a_table_with_nothing_where_one_begins(tmp_path: Path) -> None:
    recorded(tmp_path / "rec", *CHANGES)
    rows, data = exported(tmp_path, "motions")
    shown = [[row[name] for name in ("begins", "by", "samples", "largest_dps")] for row in rows[-3:]]
    assert shown == [["1", "accel", "", ""], ["0", "accel", "200", "12.34"], ["1", "accel", "", ""]]
    assert data["begins"].tolist()[-3:] == [1, 0, 1]
    assert data["by"].tolist()[-3:] == ["accel"] * 3
    np.testing.assert_array_equal(data["samples"][-3:], [np.nan, 200, np.nan])


def test_there_may_be_none(tmp_path: Path) -> None:
    recorded(tmp_path / "rec", channels=("sample",))
    with pytest.raises(UsageError, match="holds no steps: there were none, or it was recorded without"):
        export([tmp_path / "rec"], tmp_path / "out.csv", "steps", 100)
