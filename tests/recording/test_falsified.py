"""If one fact of a file is removed or falsified, the program asks the user, refuses the file, or shows the
change.
"""

import contextlib
import gc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest
from fltea.records.errors import UsageError
from fltea.settings.how import How

from tests.rig.corpus_edits import Case, Figures, falsified, figures, text_of
from tests.rig.corpus_files import ACCEL_MS2, EXAMPLES, GYRO_DPS, HERE, RATE_HZ, TIMES_S
from tests.rig.corpus_reading import OPTIONS, UNREAD_DIALECTS, how_of, pairs
from tests.rig.table_support import stored_here
from tests.rig.tiers import slow_but

pytestmark = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
"""Ignores warnings about files left open. Normally they are closed when the reader process ends."""

TEXT = [n for n in OPTIONS if n.endswith((".txt", ".csv", ".gcsv")) and n not in UNREAD_DIALECTS]

Shown = Callable[[Case, Figures], bool]


def states_unit(case: Case, found: Figures) -> bool:
    return found.says("unit", "stated", case.what)


def times_alone(case: Case, found: Figures) -> bool:
    """Return whether all times of the file are falsified, and the result says that the rate comes from these
    times.
    """
    return case.what == "all of them" and found.says("clock", "measured", "the times of")


def head_is_shown(case: Case, found: Figures) -> bool:
    number = float(
        case.what.replace(",", " ").replace("=", " ").split()[-2 if case.what.endswith("Hz") else -1]
    )
    return found.says("unit", "dialect", f"{number:g}") or any(
        found.says("clock", evidence, f"{number:g}") for evidence in ("stated", "measured")
    )


def given(case: Case, found: Figures) -> bool:
    """Return whether the result shows that the falsified fact (a unit or the rate) is what the user's option
    says. A note says so, or the file is never read without this option.

    The option is believed in two cases: the file does not state the fact, or only the documentation of the
    file's logger states it otherwise.
    """
    flag = case.kind.removeprefix("claimed ")
    noted = f"as {flag} says" in found.notes or flag in pairs(case.of.options)
    return noted and (flag == "--time-unit" or any(found.says(q, "given", flag) for q in ("unit", "clock")))


UNDETECTABLE: dict[str, tuple[str, Shown]] = {
    "another unit everywhere": ("nothing else in the file says the unit", states_unit),
    "times x2": ("no other clock is in the file", times_alone),
    "times x1000": ("no other clock is in the file", times_alone),
    "number of the head x10": ("nothing else in the file says scale or rate", head_is_shown),
    "two sensors by turns": (
        "without times the order of the rows is all there is; of longer records the judges see it",
        lambda case, found: found.says("clock", "given") or found.says("clock", "stated"),
    ),
    "claimed --rate": ("no time is in the file", given),
    "claimed --units": ("nothing in the file says the unit, or a logger's documentation alone", given),
    "claimed --time-unit": ("nothing in the file says it, or a logger's documentation alone", given),
    "names of the sensors swapped": (
        "the accelerometer's unit is not known, so its columns say nothing",
        lambda case, found: found.says("accelerometer", "missing"),
    ),
}
"""Falsifications that change the resulting figures without an error, since the file stays consistent.

For each: the reason why nothing contradicts the falsified value, and a function that returns whether the
result at least shows this value.
"""

OTHER_CLOCK_WITHOUT_UNIT = {
    *(name for name in TEXT if name.startswith("mavlink_")),
    "ardupilot_imu.csv",
    "Gyroscope.csv",
    "gopro.csv",
    "gopro_zxy.csv",
}
"""Files with two clocks, one of which has no stated unit. If the times of the other clock are multiplied by
1000, nothing contradicts this, since the clock without a unit may count in any unit.
"""


def is_of_one_fact(case: Case, found: Figures, truth: Figures) -> bool:
    """Return whether the difference between result and truth can come from one changed fact. Then only the
    sampling rate differs, or all axes differ by the same factor.
    """
    if case.kind in ("two sensors by turns", "names of the sensors swapped"):
        return True
    factors = found.noise / truth.noise
    same = found.has_gravity_of(truth) and found.means == pytest.approx(truth.means * factors[0], rel=1e-3)
    is_rate = found.rate_hz != pytest.approx(truth.rate_hz, rel=1e-2)
    return bool(same and factors == pytest.approx(1.0 if is_rate else factors[0], rel=1e-3))


def wrong_in_silence(case: Case, truth: Figures, read: Callable[[], Figures]) -> str:
    """Read a falsified file. If the result is wrong and nothing shows this, return a text that describes the
    result. Otherwise, return "".

    The result is right if the falsified file is refused, or if it is read as before the falsification.
    """
    try:
        found = read()
    except UsageError:
        return ""
    if found.is_like(truth):
        return ""
    _, is_shown = UNDETECTABLE.get(case.kind, ("", lambda *_: False))
    other = case.kind == "times x1000" and case.of.name in OTHER_CLOCK_WITHOUT_UNIT
    if (is_shown(case, found) or (other and found.says("clock", "measured"))) and is_of_one_fact(
        case, found, truth
    ):
        return ""
    rates = f"{truth.rate_hz:g} -> {found.rate_hz:g} Hz, σ {truth.noise.round(4)} -> {found.noise.round(4)}"
    said = "; ".join(f"{question}: {answer}" for question, answer in found.answers.items())
    return f"{case.kind} ({case.what}): {rates}, mean {found.means.round(3)}; {said}; {found.notes}"


@pytest.mark.parametrize("name", slow_but(sorted(TEXT)[::4], TEXT))
def test_no_falsified_text_is_wrong_in_silence(name: str) -> None:
    one = text_of(name)
    cases = list(falsified(one))
    found = [wrong_in_silence(case, one.truth, case.read) for case in cases]
    assert [line for line in found if line] == []
    assert len({case.kind for case in cases}) >= 3


Columns = dict[str, Any]

AXES = {f"gyro_{axis}_dps": GYRO_DPS[:, k] for k, axis in enumerate("xyz")}
ACCEL = {f"accel_{axis}_ms2": ACCEL_MS2[:, k] for k, axis in enumerate("xyz")}
WHOLE: Columns = {"t": TIMES_S, **AXES, **ACCEL}
SWAPPED = {a: b for one, other in zip(AXES, ACCEL, strict=True) for a, b in ((one, other), (other, one))}


def renamed(names: dict[str, str]) -> Columns:
    return {names.get(name, name): values for name, values in WHOLE.items()}


class Table(NamedTuple):
    """A table in which one fact is falsified.

    `columns`: the arrays and the sampling rates (single numbers), by name.

    `shows`: None if the reader has to refuse the table. Otherwise the answer that shows the falsification:
    question, evidence and value, such as ("unit", "stated", "rad/s").

    `says_as_much`: whether the table still has the same meaning, for example if numbers are stored as texts.
    The reader may then read it, too.
    """

    columns: Columns
    shows: tuple[str, str, str] | None = None
    says_as_much: bool = False


TABLES = {
    "no times": Table({**AXES, **ACCEL}),
    "times x10": Table({**WHOLE, "t": TIMES_S * 10}, ("clock", "measured", "the times of t")),
    "times in another unit": Table(renamed({"t": "t_ms"})),
    "a rate that the times are not of": Table({**WHOLE, "fs": 2 * RATE_HZ}),
    "another rate": Table({**AXES, "fs": 2 * RATE_HZ}, ("clock", "stated", "fs")),
    "two rates": Table({**AXES, "fs": RATE_HZ, "rate_hz": 2 * RATE_HZ}),
    "no unit": Table(renamed({name: name.removesuffix("_dps") for name in AXES})),
    "another unit of one axis": Table(renamed({"gyro_y_dps": "gyro_y_rad_s"})),
    "no unit of one axis": Table(renamed({"gyro_y_dps": "gyro_y"})),
    "another unit everywhere": Table(
        renamed({name: name.replace("dps", "rad_s") for name in AXES}), ("unit", "stated", "rad/s")
    ),
    "names of the sensors swapped": Table(renamed(SWAPPED)),
    "an axis is shorter": Table({**WHOLE, "gyro_y_dps": GYRO_DPS[:-1, 1]}),
    "an axis is no number": Table({**WHOLE, "gyro_y_dps": np.full(len(TIMES_S), "on")}),
    "an axis is texts": Table({**WHOLE, "gyro_y_dps": GYRO_DPS[:, 1].astype("U")}, says_as_much=True),
}
"""Tables with a falsification each, by its name, such as "no unit". If something else in the table
contradicts the false fact, or a fact is missing, the reader must refuse the table. Otherwise, one of its
answers must show the false fact.
"""


WRITERS = {kind: example for kind, example in EXAMPLES.items() if not example.fixed}
"""The formats that can hold any columns, with how these are written."""


@pytest.fixture(autouse=True, scope="module")
def closed_files() -> Iterator[None]:
    """Close at once the files that readers left open, and not in the middle of another test."""
    yield
    gc.collect()


def read_here(path: Path, how: How) -> Figures:
    """Read a file as the program does, but without a reader process, which takes a while to start."""
    return figures(stored_here(path, how))


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("fact", TABLES)
def test_no_falsified_table_is_wrong_in_silence(kind: str, fact: str, tmp_path: Path) -> None:
    table, example = TABLES[fact], WRITERS[kind]
    path = tmp_path / f"rest{Path(example.file).suffix}"
    if example.is_even and not all(np.size(one) == len(TIMES_S) for one in table.columns.values()):
        return
    example.write(path, WHOLE)
    truth = read_here(path, How())
    assert truth.noise == pytest.approx(GYRO_DPS.std(axis=0))
    example.write(path, table.columns)
    if table.shows is None:
        with pytest.raises(UsageError) if not table.says_as_much else contextlib.suppress(UsageError):
            assert read_here(path, How()).is_like(truth)
        return
    found = read_here(path, How())
    assert not found.is_like(truth)
    assert found.says(*table.shows)


@pytest.mark.parametrize(
    ("names", "units", "shows"),
    [
        (("gyro",), ("",), None),
        (("gyro",), ("deg/s",), ("unit", "stated", "deg/s")),
        (("gyro",), ("furlongs",), None),
        (("gyro_dps",), ("rad/s",), None),
        (("gyro_x", "gyro_y", "gyro_z"), ("deg/s", "rad/s", "deg/s"), None),
        (("gyro_x", "gyro_y", "gyro_z"), ("deg/s", "", "deg/s"), None),
    ],
)
def test_a_unit_beside_an_array_is_believed_or_refused(
    names: tuple[str, ...], units: tuple[str, ...], shows: tuple[str, str, str] | None, tmp_path: Path
) -> None:
    with h5py.File(tmp_path / "rest.h5", "w", track_order=True) as file:
        file["t"] = TIMES_S
        for k, (name, unit) in enumerate(zip(names, units, strict=True)):
            file[name] = GYRO_DPS if len(names) == 1 else GYRO_DPS[:, k]
            if unit:
                file[name].attrs["units"] = unit
    if shows is None:
        with pytest.raises(UsageError):
            read_here(tmp_path / "rest.h5", How())
    else:
        found = read_here(tmp_path / "rest.h5", How())
        assert found.says(*shows)
        assert found.noise == pytest.approx(GYRO_DPS.std(axis=0))


BINARY = {
    name: options for name, options in OPTIONS.items() if name not in TEXT and not name.startswith("fltea")
}
CLAIMS = {"--rate": ("50", "1000"), "--units": ("deg/s", "rad/s", "mrad/s"), "--time-unit": ("s", "ns")}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name == "asam.mf4"))
        for name in BINARY
        if name not in UNREAD_DIALECTS and not name.endswith((".gz", ".bz2", ".xz", ".zip"))
    ],
)
def test_what_a_file_says_is_not_overruled_in_silence(name: str) -> None:
    said = pairs(OPTIONS[name])
    truth = read_here(HERE / name, how_of(OPTIONS[name]))
    for flag, values in CLAIMS.items():
        for value in values:
            options = " ".join(f"{one} {of}" for one, of in {**said, flag: value}.items())
            try:
                found = read_here(HERE / name, how_of(options))
            except UsageError:
                continue
            noted = flag in said or f"as {flag} says" in found.notes
            assert found.is_like(truth) or noted, (options, found)
