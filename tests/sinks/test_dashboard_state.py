"""Tests that a browser's page receives only what is new to it, and that the server keeps nothing about this
page.
"""

import json

import pytest
from fltea.records.fit import AxisFit
from fltea.records.records import Sample
from fltea.sinks.page import facts
from fltea.sinks.page.course import DRAWN
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.tiers import WINDOWS
from msgspec.structs import replace

from tests.rig.dashboard_support import Reader, alone, both, records, told
from tests.rig.fit_support import FRACTIONAL, WHITE, fit_after, with_curves

NOISE = "alpha=0.5&f=-1&n=600&offset_dps=1.5&seed=3"


@pytest.fixture(scope="module")
def reader() -> Reader:
    return Reader(told(records("n=400")), DeviceHistory("other", "host"))


def test_a_part_is_sent_when_it_changed_and_not_otherwise() -> None:
    found = records("n=400")
    last = next(r for r in reversed(found) if isinstance(r, Sample))
    history = told(found)
    reader = Reader(history)
    history.write(fit_after(last, {"gyro_x": with_curves(FRACTIONAL), "gyro_y": WHITE}))
    assert set(reader.read(axis="gyro_x")["parts"]) == {"now", "axes", "axis", "curves", "own"}
    assert reader.read(axis="gyro_x")["parts"] == {}
    history.write(fit_after(last, {"gyro_x": FRACTIONAL}))
    assert reader.read(axis="gyro_x")["parts"] == {}, "a fit without curves leaves those that are drawn"
    history.write(fit_after(last, {"gyro_x": with_curves(FRACTIONAL, 2.0)}))
    assert set(reader.read(axis="gyro_x")["parts"]) == {"curves", "axis", "axes"}, "N, too"
    assert reader.read(axis="gyro_y")["parts"]["curves"][1] == []
    assert Reader(history).read(axis="gyro_x")["parts"].keys() == {"now", "axes", "axis", "curves", "own"}


def test_a_part_is_made_once_for_all_who_ask(monkeypatch: pytest.MonkeyPatch) -> None:
    reader, made = Reader(told(records("n=400"))), []
    monkeypatch.setattr(reader.state, "_make", lambda name, view: made.append(name))
    view = reader.state.view("due", "", 1)
    assert made == [], "nobody watches"
    for _ in range(20):
        reader.state.read(view, {"now": "", "axes": ""})
    assert sorted(made) == ["axes", "now"]


def test_only_new_rows_are_sent_and_of_them_what_there_is() -> None:
    found = records(NOISE)
    history = told(found)
    reader = Reader(history)
    first = reader.read(axis="gyro_y")
    rows = first["rows"]
    assert first["fresh"]
    assert len(rows["time"]) == len(rows["y_low"]) == len(rows["alpha"]) == pytest.approx(50, abs=2)
    assert not {"device_alpha", "alpha_mid", "temperature"} & rows.keys()
    assert reader.read(axis="gyro_y")["rows"] == {"time": []}
    sample = next(r for r in reversed(found) if isinstance(r, Sample))
    for k in range(1, 31):
        history.write(replace(sample, seq=sample.seq + k, host_ns=sample.host_ns + k * 10_000_000))
    again = reader.read(axis="gyro_y")
    assert (again["fresh"], len(again["rows"]["time"])) == (False, 3)
    assert reader.read(axis="gyro_y", window=1)["most"] == 302


def test_the_last_minutes_of_all_axes_come_without_one_that_is_open() -> None:
    """No axis is opened on the page. Then the first answer has data points for small diagrams of all axes,
    and later answers have only new points. All spectra come together as one part of the answer.
    """
    found = records("n=400")
    last = next(r for r in reversed(found) if isinstance(r, Sample))
    history = told(found)
    history.write(fit_after(last, {"gyro_x": with_curves(FRACTIONAL), "gyro_y": WHITE}))
    state = Reader(history).state
    view = state.view("due", "", 4)
    first = json.loads(state.read(view, {"spectra": ""}, None, ""))
    drawn = first["drawn"]
    assert (drawn["fresh"], drawn["length_ms"]) == (True, 120_000)
    wanted = {f"{axis} {name}" for axis in history.axes for name in DRAWN}
    assert drawn["rows"].keys() == {"time"} | wanted
    low, middle, high = (drawn["rows"][f"gyro_z {name}"] for name in DRAWN[:3])
    assert all(a <= b <= c for a, b, c in zip(low, middle, high, strict=True))
    assert first["parts"]["spectra"][1].keys() == {"gyro_x"}
    again = json.loads(state.read(view, {}, None, drawn["cursor"]))["drawn"]
    assert (again["fresh"], again["rows"]) == (False, {"time": []})
    assert "drawn" not in json.loads(state.read(view, {}))


def test_a_spectrum_is_drawn_again_for_a_tenth_more_samples_or_another_verdict() -> None:
    """A spectrum is not sent after each fit, since it is the largest part of an answer."""
    found = records("n=400")
    last = next(r for r in reversed(found) if isinstance(r, Sample))
    history = told(found)

    def drawn(samples: int, fit: AxisFit, scale: float) -> str:
        history.write(replace(fit_after(last, {"gyro_x": with_curves(fit, scale)}), samples=samples))
        return facts.spectra(history)["gyro_x"]

    first = drawn(1000, FRACTIONAL, 1.0)
    assert drawn(1099, FRACTIONAL, 2.0) == first
    second = drawn(1100, FRACTIONAL, 3.0)
    assert second != first
    assert drawn(1101, WHITE, 4.0) != second


def test_a_second_costs_little() -> None:
    """The updates of a second may be a few kB. Sizes are in bytes before compression, which reduces them to a
    third.

    An earlier page took 28,000 bytes a second.
    """
    found = records("n=1500")
    begin = next(i for i, r in enumerate(found) if isinstance(r, Sample) and r.seq == 1300)
    history = told(found[:begin])
    quiet, open_one = Reader(history), Reader(history)
    view = quiet.state.view("due", "gyro_x", 0)
    for reader in (quiet, open_one):
        reader.read(axis="gyro_x")
    cursor = json.loads(quiet.state.read(view, {}, None, ""))["drawn"]["cursor"]
    for record in found[begin : begin + 205]:
        history.write(record)
    quiet.state._kept.clear()
    assert len(quiet.state.read(view, {"now": "", "axes": ""})) < 1500
    assert len(json.dumps(open_one.read(axis="gyro_x"))) < 5000
    rows = json.loads(quiet.state.read(view, {}, None, cursor))["drawn"]["rows"]
    assert 2 <= len(rows["time"]) <= 7
    assert len(json.dumps(rows)) < 1500, "of two seconds"


def test_a_reader_of_another_start_gets_all() -> None:
    reader, other = (Reader(told(records("n=400"))) for _ in range(2))
    reader.read(axis="gyro_x")
    other.cursor = reader.cursor
    assert other.read(axis="gyro_x")["fresh"]


def test_each_device_has_what_belongs_to_its_estimator() -> None:
    histories = {
        "both": told(both(records(NOISE)), who="both"),
        "alone": told(alone(records(NOISE)), who="device"),
        "host": told(records(NOISE)),
    }
    for name, history in histories.items():
        history.name = name
    reader = Reader(*histories.values())
    for name in histories:
        found = reader.read(name, "gyro_y", parts="own axis")
        assert ("device_alpha" in found["rows"]) == (name == "both")
        assert (reader.parts["axis"]["compared"] is not None) == (name == "both")
        assert bool(reader.parts["own"]) == (name != "host")


@pytest.mark.parametrize(
    ("choice", "seen"),
    [
        (("", "", 0), ("due", "", 0)),
        (("due", "gyro_z", 3), ("due", "gyro_z", 3)),
        (("other", "gyro_x", 2), ("other", "", 2)),
        (("<script>", "gyro_q", 99), ("due", "", len(WINDOWS) - 1)),
    ],
)
def test_what_there_is_not_is_replaced(
    reader: Reader, choice: tuple[str, str, int], seen: tuple[str, str, int]
) -> None:
    found = reader.read(*choice)
    assert (found["device"], found["axis"], found["window"]) == seen


def test_nonsense_changes_nothing(reader: Reader) -> None:
    view = reader.state.view("due", "gyro_x", 1)
    for cursor in ("x.y", "1.-5", "9" * 50 + "." + "9" * 50, ".", "²."):
        found = json.loads(reader.state.read(view, {"no such part": "", "": ""}, cursor))
        assert found["parts"] == {}
        assert found["fresh"]


def test_what_is_kept_is_bounded() -> None:
    reader = Reader(*(DeviceHistory(f"d{k}", "host") for k in range(400)))
    for k in range(400):
        reader.state.read(reader.state.view(f"d{k}", "", 1), {"link": ""})
    assert len(reader.state._kept) <= 256
