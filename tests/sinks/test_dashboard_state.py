"""A page is sent what is new to it, and nothing is kept for it."""

import json

import pytest
from dashboard_support import Reader, alone, both, records, told
from fit_support import FRACTIONAL, WHITE, fit_after, with_curves
from fltea.records.records import Estimate, Sample
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.tiers import WINDOWS
from msgspec.structs import replace

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
    assert set(reader.read(axis="gyro_x")["parts"]) == {"curves", "axis"}, "coefficients, too"
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


def test_rows_are_those_of_the_tables_and_only_new_ones_are_sent() -> None:
    found = records(NOISE)
    history = told(found)
    reader = Reader(history)
    first = reader.read(axis="gyro_y")["rows"]["rows"]
    assert first["fresh"]
    times = first["columns"]["time"]
    estimates = {round(e.host_ns * 1e-6): e for e in found if isinstance(e, Estimate)}
    last = estimates[max(t for t in estimates if t <= times[-1] + 50)].axes["gyro_y"].fltea
    assert first["columns"]["alpha"][-1] == pytest.approx(last.alpha, abs=2e-3)
    assert len(times) == len(first["columns"]["y_low"]) == pytest.approx(50, abs=2)
    assert all(
        low <= y <= high
        for low, y, high in zip(*(first["columns"][k] for k in ("y_low", "y", "y_high")), strict=True)
    )
    assert reader.read(axis="gyro_y")["rows"]["rows"]["columns"]["time"] == []
    sample = next(r for r in reversed(found) if isinstance(r, Sample))
    for k in range(1, 31):
        history.write(replace(sample, seq=sample.seq + k, host_ns=sample.host_ns + k * 10_000_000))
    again = reader.read(axis="gyro_y")["rows"]["rows"]
    assert not again["fresh"]
    assert len(again["columns"]["time"]) == 3
    assert again["most"] <= 302


def test_a_reader_of_another_start_gets_all() -> None:
    reader, other = (Reader(told(records("n=400"))) for _ in range(2))
    reader.read(axis="gyro_x")
    other._cursors = reader._cursors
    assert other.read(axis="gyro_x")["rows"]["rows"]["fresh"]


def test_each_device_has_the_tables_of_its_estimator() -> None:
    histories = {
        "both": told(both(records(NOISE)), who="both"),
        "alone": told(alone(records(NOISE)), who="device"),
        "host": told(records(NOISE)),
    }
    for name, history in histories.items():
        history.name = name
    reader = Reader(*histories.values())
    tables = {name: set(reader.read(name, "gyro_y")["rows"]) for name in histories}
    assert tables == {
        "both": {"rows", "fits", "checks", "compared"},
        "alone": {"rows", "fits", "own"},
        "host": {"rows", "fits", "checks"},
    }
    for name in histories:
        reader.read(name, "gyro_y", parts="own axis")
        assert (reader.parts["axis"]["compared"] is not None) == (name == "both")
        assert bool(reader.parts["own"]) == (name != "host")


@pytest.mark.parametrize(
    ("choice", "seen"),
    [
        (("", "", 1), ("due", "", 1)),
        (("due", "gyro_z", 3), ("due", "gyro_z", 3)),
        (("other", "gyro_x", 2), ("other", "", 2)),
        (("<script>", "gyro_q", 99), ("due", "", len(WINDOWS) - 1)),
        (("due", "gyro_x", 0), ("due", "gyro_x", 1)),
    ],
)
def test_what_there_is_not_is_replaced(
    reader: Reader, choice: tuple[str, str, int], seen: tuple[str, str, int]
) -> None:
    found = reader.read(*choice)
    assert (found["device"], found["axis"], found["window"]) == seen


def test_nonsense_changes_nothing(reader: Reader) -> None:
    view = reader.state.view("due", "gyro_x", 1)
    for cursors in ({"rows": "x.y"}, {"rows": "1.-5"}, {"rows": "9" * 50 + "." + "9" * 50}, {"q": ""}):
        found = json.loads(reader.state.read(view, {"no such part": "", "": ""}, cursors))
        assert found["parts"] == {}
        assert found["rows"]["rows"]["fresh"]


def test_what_is_kept_is_bounded() -> None:
    reader = Reader(*(DeviceHistory(f"d{k}", "host") for k in range(400)))
    for k in range(400):
        reader.state.read(reader.state.view(f"d{k}", "", 1), {"link": ""})
    assert len(reader.state._kept) <= 256
