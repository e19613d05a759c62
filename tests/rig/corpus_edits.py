"""Remove or falsify one fact in a text file, and compare the figures that the program then reads.

The files are those of tests/recording/corpus.
"""

import io
import math
import re
from collections.abc import Callable, Iterator, Sequence
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from fltea.identification.gaps import no_gaps
from fltea.identification.judges import judge
from fltea.recording.column_names import is_time
from fltea.recording.csv_file import open_csv
from fltea.recording.files import Stored
from fltea.recording.reading import Answer
from fltea.recording.row_layout import Layout
from fltea.recording.text_rows import TextReader
from fltea.records.records import ACCEL_AXES, AXES

from tests.rig.corpus_files import HERE
from tests.rig.corpus_reading import OPTIONS, how_of, pairs


class Figures(NamedTuple):
    """The figures that the program computes and shows for one recording.

    `gravity_ms2`: mean specific force [m/s²], or None without an accelerometer.
    """

    rate_hz: float
    noise: np.ndarray
    means: np.ndarray
    gravity_ms2: float | None
    answers: dict[str, Answer]
    notes: str
    marks: frozenset[str]

    def is_like(self, other: "Figures") -> bool:
        """Return whether all figures of two recordings agree. The means may differ by a tenth of the noise,
        all other figures by 5 %.
        """
        if self.noise.shape != other.noise.shape or not _near(self.rate_hz, other.rate_hz):
            return False
        return (
            all(map(_near, self.noise, other.noise))
            and bool((np.abs(self.means - other.means) < 0.1 * other.noise).all())
            and self.has_gravity_of(other)
        )

    def has_gravity_of(self, other: "Figures") -> bool:
        """Return whether the mean specific force equals that of `other` within 5 %, or the program says that
        it may be wrong.

        The program says so if it reports that the accelerometer was not read, or if a data check marks
        gravity as wrong.
        """
        if None not in (self.gravity_ms2, other.gravity_ms2):
            return (
                _near(float(self.gravity_ms2 or 0), float(other.gravity_ms2 or 0)) or "gravity" in self.marks
            )
        return self.gravity_ms2 is other.gravity_ms2 or self.says("accelerometer", "missing")

    def says(self, question: str, evidence: str, value: str = "") -> bool:
        """Return whether the program's answer to a question about the file (such as "unit") rests on this
        kind of evidence (such as "measured").

        The answer's value or reason must also contain the text `value`.
        """
        answer = self.answers.get(question)
        return answer is not None and answer.evidence == evidence and value in f"{answer.value}; {answer.why}"


def _near(a: float, b: float) -> bool:
    return abs(math.log(a / b)) < 0.05


def figures(stored: Stored) -> Figures:
    """Return the figures of a recording, and the kinds of data checks that reported something."""
    whole = stored.whole()
    gyro = whole.gyro / (stored.lsb_per_dps or 1.0)
    columns = dict(zip(AXES, gyro.T, strict=False))
    if whole.accel_ms2 is not None:
        columns |= dict(zip(ACCEL_AXES, whole.accel_ms2.T, strict=True))
    marks = judge(columns.__getitem__, dict.fromkeys(columns), 1 / stored.rate_hz, no_gaps(), stored.reading)
    return Figures(
        stored.rate_hz,
        gyro.std(axis=0),
        gyro.mean(axis=0),
        None if whole.accel_ms2 is None else float(np.linalg.norm(whole.accel_ms2.mean(axis=0))),
        {answer.question: answer for answer in stored.reading},
        "\n".join(note.text for note in stored.notes),
        frozenset(data_check.kind for data_check in marks),
    )


class Text(NamedTuple):
    """A text file split into its rows, with the numbers of the rows that matter.

    `begin`: number of the first line with samples. `header`, `units`: numbers of the lines with column names
    and with units, -1 if absent.
    """

    name: str
    options: str
    lines: list[str]
    layout: Layout
    begin: int
    header: int
    units: int
    truth: Figures

    @property
    def names(self) -> list[str]:
        return self.layout.chosen.names

    @property
    def gyro(self) -> tuple[int, ...]:
        return self.layout.chosen.gyro

    @property
    def clocks(self) -> list[int]:
        """Return the indices of all columns with times.

        If the columns have no names, these are only the columns that the reader uses as times.
        """
        chosen = self.layout.chosen
        named = [k for k, name in enumerate(self.names) if is_time(name)] if self.header >= 0 else []
        return sorted({*named, *(place for place in (chosen.time, chosen.clock.fine) if place is not None)})


class Case(NamedTuple):
    """One falsified file.

    `kind`: kind of the falsification in the test's table. `name`, `options`: file name and options for
    reading the file.
    """

    of: Text
    kind: str
    what: str
    text: str
    name: str
    options: str

    def read(self) -> Figures:
        """Read the falsified file as the program does.

        Raises:
            UsageError: The file is refused.
        """
        return read_text(self.name, self.text, self.options)


def read_text(name: str, text: str, options: str) -> Figures:
    return figures(open_csv(Path(name), how_of(options), file=io.BytesIO(text.encode())))


def text_of(name: str) -> Text:
    """Split a file of the corpus as the reader understands it.

    The result contains the number of the first line with samples, and those of the lines with column names
    and with units.
    """
    data = (HERE / name).read_bytes()
    text = data.decode("utf-16" if data.startswith(b"\xff\xfe") else "utf-8-sig")
    options = OPTIONS[name]
    reader = TextReader(name, how_of(options))
    reader.feed(text.encode())
    reader.finish()
    layout = reader.layout
    assert layout is not None
    lines = text.splitlines(keepends=True)
    above = [line.strip() for line in lines[: layout.begin]]
    header, units = (above.index(one) if one and one in above else -1 for one in (layout.again or ("", "")))
    if layout.chosen.names and header < 0 and layout.again:
        header = next((k for k, line in enumerate(above) if layout.again[0] in line), -1)
    return Text(name, options, lines, layout, layout.begin - 1, header, units, read_text(name, text, options))


UNITS = {
    "rad/s": r"rad/s|rad s\^-1|radians/s|(?<=_)rads?(?![a-z])",
    "deg/s": r"deg/s|°/s|(?<![m\w])dps|(?<=_)dps|DPS|(?<=\()d/s|degrees/second",
    "mdeg/s": r"mdps",
}
"""Spellings of units of angular rate in the files of the corpus."""
OTHER = {"rad/s": "deg/s", "deg/s": "rad/s", "mdeg/s": "mrad/s"}
_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.:])")


def falsified(one: Text) -> Iterator[Case]:
    """Yield copies of a text file. In each, one fact is wrong or missing, such as a unit or the header."""
    for edit in (_head, _columns, _marks, _clocks, _units, _sensors, _claims):
        yield from edit(one)


def _head(one: Text) -> Iterator[Case]:
    case = _case(one)
    if one.header >= 0:
        yield case("no names", "", _without_lines(one, one.header))
    if one.units >= 0:
        yield case("no row of units", "", _without_lines(one, one.units))
    others = [k for k in range(one.begin) if k not in (one.header, one.units)]
    if len(others) > 1:
        yield case("no head", "", _without_lines(one, *others))
    for k in others:
        yield case("no line of the head", one.lines[k].strip(), _without_lines(one, k))
        changed = _NUMBER.sub(lambda found: f"{float(found[0]) * 10:.9g}", one.lines[k])
        if changed != one.lines[k]:
            yield case("number of the head x10", changed.strip(), _with_line(one, k, changed))
    suffix = Path(one.name).suffix
    text = "".join(one.lines)
    yield case("other name", "", text)._replace(name=f"recording{suffix}")
    yield case("other ending", "", text)._replace(
        name=Path(one.name).stem + (".csv" if suffix == ".txt" else ".txt")
    )


def _columns(one: Text) -> Iterator[Case]:
    case, sensor = _case(one), one.layout.chosen.sensor
    if one.layout.parse is not None:
        return
    for k in one.clocks:
        yield case("no column of times", str(k), _each_row(one, partial(_without, [k]), [k]))
    if len(one.clocks) > 1:
        yield case("no times", "", _each_row(one, partial(_without, one.clocks), one.clocks))
    if sensor is not None and one.header >= 0:
        k = sensor[0]
        yield case("no column of sensors", "", _each_row(one, partial(_without, [k]), [k]))
        alike = _each_row(one, lambda fields: [*fields[:k], "0", *fields[k + 1 :]])
        yield case("sensors alike", "", alike)


def _marks(one: Text) -> Iterator[Case]:
    case, names = _case(one), one.names
    if one.layout.chosen.accel and one.header >= 0:
        header = one.lines[one.header]
        for a, b in zip(one.gyro, one.layout.chosen.accel, strict=True):
            header = header.replace(names[a], "\0").replace(names[b], names[a]).replace("\0", names[b])
        yield case("names of the sensors swapped", "", _with_line(one, one.header, header))
    lines = [re.sub(r"\*[0-9A-F]{2}(?=\s*$)", "", line) for line in one.lines]
    if lines != one.lines:
        yield case("no checksum", "", "".join(lines))
        wrong = [re.sub(r"\*[0-9A-F]{2}(?=\s*$)", "*00", line) for line in one.lines]
        yield case("wrong checksum", "", "".join(wrong))


def _clocks(one: Text) -> Iterator[Case]:
    chosen = one.layout.chosen
    if one.layout.parse is not None or chosen.time is None or chosen.clock.fine is not None:
        return
    for factor in (2, 1000):
        for what, which in {"the one that is read": [chosen.time], "all of them": one.clocks}.items():
            text = _each_row(one, partial(_scaled, which, factor, {}))
            is_all = what == "all of them"
            if text != "".join(one.lines) and is_all >= (len(one.clocks) == 1):
                yield _case(one)(f"times x{factor}", what, text)


def _units(one: Text) -> Iterator[Case]:
    case, is_table = _case(one), one.layout.parse is None
    stated = one.begin if is_table else len(one.lines)
    for unit, pattern in UNITS.items():

        def changed(to: str, most: int = 0, pattern: str = pattern) -> str:
            return "".join(
                [*(re.sub(pattern, to, line, count=most) for line in one.lines[:stated]), *one.lines[stated:]]
            )

        if not any(re.search(pattern, line) for line in one.lines[:stated]):
            continue
        yield case("another unit everywhere", OTHER[unit], changed(OTHER[unit]))
        if is_table:
            yield case("another unit of one axis", OTHER[unit], changed(OTHER[unit], 1))
        alone = rf"\s*[\[(](?:{pattern})[\])]|[_ ](?:{pattern})|(?:{pattern})"
        yield case("no unit", unit, changed("", pattern=alone))


def _sensors(one: Text) -> Iterator[Case]:
    if one.layout.parse is None:
        text = _each_row(
            one,
            lambda fields: [_times(field, -3) if k in one.gyro else field for k, field in enumerate(fields)],
            twice=True,
        )
        yield _case(one)("two sensors by turns", "", text)


def _claims(one: Text) -> Iterator[Case]:
    text, given = "".join(one.lines), pairs(one.options)
    rate_hz = one.truth.rate_hz
    claims = [("--rate", f"{rate_hz * factor:g}") for factor in (0.1, 2)]
    claims += [("--units", unit) for unit in ("deg/s", "rad/s", "mrad/s")]
    units = ("s", "ms", "us", "ns")
    known = units.index(one.layout.chosen.clock.unit or "s")
    claims += [("--time-unit", units[k]) for k in (known - 1, known + 1) if one.clocks and 0 <= k < 4]
    claims += [("--accel-units", unit) for unit in ("g", "m/s^2")] if one.layout.chosen.accel else []
    for flag, value in claims:
        if given.get(flag) != value:
            said = " ".join(f"{name} {one_}" for name, one_ in {**given, flag: value}.items())
            yield _case(one)(f"claimed {flag}", value, text)._replace(options=said)


def _case(one: Text) -> Callable[[str, str, str], Case]:
    return lambda kind, what, text: Case(one, kind, what, text, one.name, one.options)


def _without(gone: Sequence[int], fields: list[str]) -> list[str]:
    return [field for place, field in enumerate(fields) if place not in gone]


def _without_lines(one: Text, *gone: int) -> str:
    return "".join(line for k, line in enumerate(one.lines) if k not in gone)


def _with_line(one: Text, place: int, line: str) -> str:
    return "".join([*one.lines[:place], line, *one.lines[place + 1 :]])


def _each_row(
    one: Text,
    edit: Callable[[list[str]], list[str]],
    gone: Sequence[int] = (),
    *,
    twice: bool = False,
) -> str:
    """Edit the fields of each row by a function. Also remove the columns `gone` from the lines with names and
    units.

    `twice`: keep each original row before the edited row.
    """
    separator, lines = one.layout.separator, list(one.lines)
    for k in (one.header, one.units) if gone else ():
        if k >= 0:
            fields = one.names if k == one.header else lines[k].strip("\r\n").split(separator)
            mark = "# " if lines[k].startswith("#") else ""
            lines[k] = mark + (separator or " ").join(_without(gone, fields)) + "\n"
    for k in range(one.begin, len(lines)):
        fields = lines[k].strip("\r\n").split(separator)
        if len(fields) > max(one.gyro) and not lines[k].startswith(("$BARO", "ACCE", "MAGN")):
            row = (separator or " ").join(edit(fields)) + "\n"
            lines[k] = lines[k] + row if twice else row
    return "".join(lines)


def _times(field: str, factor: int) -> str:
    number, star, rest = field.partition("*")
    return f"{Decimal(number.strip().replace(',', '.')) * factor}{star}{rest}".replace(
        ".", "," if "," in number else "."
    )


def _scaled(which: list[int], factor: int, first: dict[int, Decimal], fields: list[str]) -> list[str]:
    """Multiply the time since the first row by `factor`, in the columns `which`; dates stay unchanged."""
    fields = list(fields)
    for k in which:
        try:
            time = Decimal(fields[k].strip().replace(",", "."))
        except ArithmeticError:
            continue
        begin = first.setdefault(k, time)
        fields[k] = f"{begin + (time - begin) * factor:f}".replace(".", "," if "," in fields[k] else ".")
    return fields
