"""Tests the answers to each question about a file (unit, clock, axes …) from each kind of evidence. The
strongest evidence decides, and contradictions are reported.
"""

import shlex
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from fltea.recording.clocks import clock_of
from fltea.recording.columns import Chosen, choose
from fltea.recording.dialects import Facts
from fltea.recording.reading import ASK, Answer, Missing, NotStated, given_options, not_stated
from fltea.recording.sample_times import Elapsed, TimeColumn
from fltea.recording.timing import timing
from fltea.recording.units import PER_UNIT, parse_units
from fltea.records.errors import UsageError
from fltea.settings.how import How, TimeUnit
from hypothesis import assume, given
from hypothesis import strategies as st

PLAIN = ["t", "gx", "gy", "gz", "ax", "ay", "az"]
OF_DIALECT = ["time", "gFx", "gFy", "gFz", "wx", "wy", "wz"]
"""Columns of the app Physics Toolbox, whose units are s, g and rad/s."""
OF_CONVENTION = [
    "field.header.stamp",
    *(f"field.{what}.{axis}" for what in ("angular_velocity", "linear_acceleration") for axis in "xyz"),
]
"""Columns of ROS 1, whose units are ns, rad/s and m/s²."""
N = 60
IN_G = np.hstack([np.arange(N)[:, np.newaxis] / 100, np.full((N, 3), 0.1), np.full((N, 3), 0.6)])
IN_G[:, 6] = 0.53


def read(
    names: Sequence[str] | None,
    row: Sequence[str] | None = None,
    *,
    facts: Facts | None = None,
    width: int = 0,
    tag: str = "",
    **how: Any,
) -> Chosen:
    """Return the columns that are chosen for these names and this row of units."""
    facts = Facts() if facts is None else facts
    return choose("rest", names, row, width or len(names or ()), How(**how), facts, tag)


def refusal(*arguments: Any, **how: Any) -> str:
    with pytest.raises(UsageError) as caught:
        read(*arguments, **how)
    return str(caught.value)


def said(chosen: Chosen, question: str) -> Answer:
    """Return the answer that the reader gives to a question about the file. Check that there is only one."""
    (found,) = [answer for answer in chosen.answers if answer.question == question]
    return found


SAMPLE = Facts(sample=lambda: IN_G)
HEAD = Facts(head="Data File Created By ActiGraph Link at 100 Hz\n")
GYROSCOPE = [f"Gyroscope {axis}" for axis in "XYZ"]


def given_by(names: Sequence[str] | None, **how: Any) -> dict[str, Any]:
    return {"names": names, "units": "dps", **how}


ROS_GYRO, ROS_ACCEL = ", ".join(OF_CONVENTION[1:4]), ", ".join(OF_CONVENTION[4:])
TAGGED: dict[str, Any] = {"rate_hz": 40.0, "columns": ["3", "4", "5"]}

ANSWERS: list[tuple[dict[str, Any], str, str]] = [
    (given_by(["p", "q"], columns=["q"], rate_hz=1.0), "columns", "q as x (given: --columns)"),
    (given_by(PLAIN), "columns", "gx, gy, gz as x, y, z (stated: their names)"),
    ({"names": OF_DIALECT}, "columns", "wx, wy, wz as x, y, z (dialect: Physics Toolbox)"),
    ({"names": OF_CONVENTION}, "columns", f"{ROS_GYRO} as x, y, z (convention: ROS 1 echo)"),
    (given_by(PLAIN), "unit", "dps (given: --units)"),
    ({"names": ["t", "gx_rads"]}, "unit", "rad/s (stated: the names or the row of units)"),
    ({"names": ["t", "gx"], "row": ["s", "°/s"]}, "unit", "deg/s (stated: the names or the row of units)"),
    ({"names": OF_DIALECT}, "unit", "rad/s (dialect: Physics Toolbox)"),
    ({"names": OF_CONVENTION}, "unit", "rad/s (convention: ROS 1 echo)"),
    (given_by(PLAIN, rate_hz=50.0), "clock", "50 Hz (given: --rate)"),
    ({"names": GYROSCOPE, "facts": HEAD}, "clock", f"100 Hz (stated: the head: {HEAD.head.strip()})"),
    ({"names": ["gx_dps"], "facts": Facts(rates={"imu.fs": 200.0})}, "clock", "200 Hz (stated: imu.fs)"),
    (given_by(["imu", *PLAIN], topic="2"), "sensor", "imu is 2 (given: --sensor)"),
    (given_by(["p", *PLAIN], topic="p=2"), "sensor", "p is 2 (given: --sensor)"),
    (given_by(PLAIN, topic="2/3"), "sensor", "row 2 of every 3 (given: --sensor)"),
    (
        {"names": None, "width": 10, "tag": "$VNIMU", "rate_hz": 40.0},
        "rows",
        "those that begin with $VNIMU (dialect: VectorNav VNIMU, VNMAR)",
    ),
    (
        given_by(None, width=5, tag="G", topic="G", **TAGGED),
        "rows",
        "those that begin with G (given: --sensor)",
    ),
    (given_by(PLAIN, accel_units="mg"), "accelerometer", "ax, ay, az in mg (given: --accel-units)"),
    (
        given_by(PLAIN, row=["", "", "", "", "g", "g", "g"]),
        "accelerometer",
        "ax, ay, az (stated: the unit is in the names or the row of units)",
    ),
    ({"names": OF_DIALECT}, "accelerometer", "gFx, gFy, gFz in g (dialect: Physics Toolbox)"),
    ({"names": OF_CONVENTION}, "accelerometer", f"{ROS_ACCEL} in m/s^2 (convention: ROS 1 echo)"),
    (
        given_by(PLAIN, facts=SAMPLE),
        "accelerometer",
        "ax, ay, az in g (measured: their length is that of gravity)",
    ),
    (
        given_by(PLAIN),
        "accelerometer",
        "not read (missing: nothing says the unit of ax, ay, az; --accel-units says it)",
    ),
]


@pytest.mark.parametrize(("what", "question", "answer"), ANSWERS, ids=[one[2] for one in ANSWERS])
def test_each_answer_names_its_evidence(what: dict[str, Any], question: str, answer: str) -> None:
    assert str(said(read(**what), question)) == answer


ASKED: list[tuple[dict[str, Any], str]] = [
    ({"names": ["a", "b"], "rate_hz": 9.0}, "--rate 9 --columns ?,?,? --units ?"),
    ({"names": PLAIN}, "--units ?"),
    ({"names": PLAIN[1:], "accel_units": "g"}, "--accel-units g --units ? --rate ?"),
    (given_by(PLAIN[1:]), "--units dps --rate ?"),
    ({"names": ["gx_dps"], "time_unit": "ms"}, "--time-unit ms --rate ?"),
    ({"names": ["time", "stamp", "gx_dps"]}, "--time-column ?"),
    ({"names": ["a"]}, "--columns ?,?,? --units ? --rate ?"),
    ({"names": None, "width": 3}, "--columns ?,?,? --units ? --rate ?"),
    ({"names": ["t", "gx_dps", "gy", "gz_dps"]}, "--units ?"),
]


@pytest.mark.parametrize(("what", "options"), ASKED)
def test_what_nobody_says_is_asked_for_and_nothing_else(what: dict[str, Any], options: str) -> None:
    with pytest.raises(NotStated) as caught:
        read(**what)
    asked = str(caught.value).partition(ASK)[2].partition("\n")[0]
    assert asked == options


def test_what_is_asked_for_can_be_typed() -> None:
    how = How(columns=["Gyro X", "it's"], units="deg/s", time_column="t;", overrule=True)
    words = shlex.split(" ".join(given_options(how)))
    assert words == ["--columns", "Gyro X,it's", "--units", "deg/s", "--time-column", "t;", "--overrule"]
    text = str(not_stated("rest", [Missing("this", "--a ?"), Missing("that", "--b ?")], ["--c 1"], "table"))
    assert text == f"rest: nothing says this; and that. {ASK}--c 1 --a ? --b ?\ntable"


# --- the strongest evidence decides ---

UNITS = ["deg/s", "rad/s", "mdeg/s", "mrad/s", "deg/h"]
MAYBE = st.none() | st.sampled_from(UNITS)


def expected(given_: str | None, stated: set[str], told: str | None) -> tuple[str, str] | None:
    """Return what the reader should conclude from the evidence about a unit: the unit, and the evidence that
    decides.

    If the evidence is contradictory, return ("", reason). If there is none, return None.
    """
    if len(stated) > 1:
        return None if given_ is None and not stated else ("", "differ")
    if given_ is not None:
        return ("", "says otherwise") if stated - {given_} else (given_, "given")
    if stated:
        (unit,) = stated
        return ("", "contradicted") if told is not None and told != unit else (unit, "stated")
    return None if told is None else (told, "told")


@given(MAYBE, MAYBE, MAYBE, st.sampled_from(["none", "dialect", "convention"]))
def test_a_weaker_unit_never_beats_a_stronger_one(
    given_: str | None, name: str | None, row: str | None, kind: str
) -> None:
    names = {"none": PLAIN, "dialect": OF_DIALECT, "convention": OF_CONVENTION}[kind]
    gyro = [4, 5, 6] if kind == "dialect" else [1, 2, 3]
    if kind == "none" and name is not None:
        names = [f"{one} [{name}]" if place in gyro else one for place, one in enumerate(names)]
    stated = {unit for unit in (name if kind == "none" else None, row) if unit is not None}
    units = None if row is None else [row if place in gyro else "" for place in range(len(names))]
    wanted = expected(given_, stated, None if kind == "none" else "rad/s")
    if wanted is None or not wanted[0]:
        with pytest.raises(UsageError) as caught:
            read(names, units, units=given_)
        assert (wanted is None) == isinstance(caught.value, NotStated)
        assert all(unit in str(caught.value) for unit in stated)
        assert len(stated) != 1 or (given_ or "rad/s") in str(caught.value)
        if given_ is not None:
            assert read(names, units, units=given_, overrule=True).unit.factor == parse_units(given_)[0]
        return
    unit, evidence = wanted
    chosen = read(names, units, units=given_)
    answer = said(chosen, "unit")
    assert (answer.value, chosen.unit.factor, chosen.unit.lsb) == (unit, PER_UNIT[unit], None)
    assert answer.evidence == (kind if evidence == "told" else evidence)
    told_otherwise = kind != "none" and evidence == "given" and unit != "rad/s"
    assert [note.kind for note in chosen.notes] == ["reading"] * told_otherwise


TIMES: list[TimeUnit] = ["s", "ms", "us", "ns"]


@given(*[st.none() | st.sampled_from(TIMES)] * 3, st.sampled_from(["none", "dialect", "convention"]))
def test_a_weaker_unit_of_times_never_beats_a_stronger_one(
    given_: TimeUnit | None, name: TimeUnit | None, row: TimeUnit | None, kind: str
) -> None:
    names = list({"none": PLAIN, "dialect": OF_DIALECT, "convention": OF_CONVENTION}[kind])
    if kind == "none" and name is not None:
        names[0] = f"t [{name}]"
    units = None if row is None else [row, *[""] * (len(names) - 1)]
    stated = {unit for unit in (name if kind == "none" else None, row) if unit is not None}
    told, dialect = {
        "none": (None, ""),
        "dialect": ("s", "Physics Toolbox"),
        "convention": ("ns", "ROS 1 echo"),
    }[kind]
    how: dict[str, Any] = {"units": "rad/s", "time_unit": given_}
    if len(stated) > 1 or (given_ is not None and stated - {given_}):
        text = refusal(names, units, **how)
        assert all(f" {unit} " in text or f"[{unit}]" in text for unit in stated)
        assert read(names, units, **{**how, "time_unit": "us"}, overrule=True).clock.unit == "us"
        return
    chosen = read(names, units, **how)
    assert chosen.clock.unit == (given_ or next(iter(stated), None) or told)
    is_note = told is not None and given_ not in (None, told)
    text = f"as --time-unit says; by {dialect} it counts {told}"
    assert [text in note.text for note in chosen.notes] == [True] * is_note


def test_seconds_in_two_columns_have_no_other_unit() -> None:
    names = ["stamp.sec", "stamp.nanosec", "gx_dps"]
    chosen = read(names)
    assert chosen.clock == (0, "s", 1.0, 1, 1e-9, ())
    assert read(names, time_unit="s") == chosen
    assert "is in s by its name or line of units, and --time-unit ms" in refusal(names, time_unit="ms")


@given(
    st.sampled_from(["g", "mg", "m/s^2"]), st.none() | st.sampled_from(["g", "mg", "m/s^2"]), st.booleans()
)
def test_a_weaker_unit_of_accelerations_never_beats_a_stronger_one(
    stated: str, given_: str | None, is_row: bool
) -> None:
    names = PLAIN if is_row else [*PLAIN[:4], *(f"{one} [{stated}]" for one in PLAIN[4:])]
    units = ["", "", "", "", stated, stated, stated] if is_row else None
    how: dict[str, Any] = {"units": "dps", "accel_units": given_}
    ms2 = {"g": 9.80665, "mg": 9.80665e-3, "m/s^2": 1.0}
    if given_ not in (None, stated):
        assert "have another unit by their names or the row of units" in refusal(names, units, **how)
        assert read(names, units, **how, overrule=True).accel_ms2 == ms2[str(given_)]
        return
    chosen = read(names, units, **how)
    assert chosen.accel_ms2 == ms2[stated]
    assert said(chosen, "accelerometer").evidence == ("stated" if given_ is None else "given")


# --- rates against times ---

RATES = st.sampled_from([10.0, 50.0, 100.0, 333.0, 1000.0])


@given(RATES, RATES, st.booleans(), st.booleans())
def test_a_rate_that_the_times_contradict_is_an_error(
    true_hz: float, rate_hz: float, is_given: bool, overrule: bool
) -> None:
    assume(true_hz != rate_hz)
    elapsed = Elapsed("s")
    times, _ = elapsed.add(np.arange(200) / true_hz, np.arange(200.0)[:, np.newaxis])
    clock = clock_of(lambda: [times], elapsed)

    def found(hz: float | None) -> float:
        return timing("rest", TimeColumn("t", "s", hz, is_given, overrule), clock, elapsed).rate_hz

    if overrule:
        assert found(rate_hz) == (rate_hz if is_given else pytest.approx(true_hz))
    else:
        with pytest.raises(UsageError) as caught:
            found(rate_hz)
        assert all(f"{hz:g} " in str(caught.value) for hz in (true_hz, rate_hz))
    assert found(true_hz) == pytest.approx(true_hz)
