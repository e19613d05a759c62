"""Tests the table of dialects, which describe what each logger writes in a format.

Each dialect's example file holds everything that its row describes, and a file that matches only in part is
not recognised.
"""

import re
from collections.abc import Iterator, Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np
import pytest
from fltea.recording import columns, dialects
from fltea.recording.column_names import accel_axis_of
from fltea.recording.csv_file import open_csv
from fltea.recording.dialects import MOST_NAMES, Dialect, Facts, columns_of, dialect_of
from fltea.recording.formats import FORMATS, loaded
from fltea.recording.sheet import open_sheet, with_sample
from fltea.recording.text_head import stated_in
from fltea.recording.units import accel_unit, parse_units, rate_unit, time_unit
from fltea.records.errors import UsageError
from fltea.settings.limits import DEFAULT_LIMITS

from tests.rig.corpus_files import HERE
from tests.rig.corpus_reading import OPTIONS, how_of, pairs

TABLE = dialects.dialects()
APART = {"ronin.h5": "hdf5", "ardupilot.mat": "mat"}
"""Files that are read by libraries in a reader process."""

FILES = [
    (one, name)
    for one in TABLE
    for name in one.corpus
    if name in APART or name.endswith((".csv", ".txt", ".gcsv"))
]
of_each_file = pytest.mark.parametrize(("one", "name"), FILES, ids=[f"{d.name}-{n}" for d, n in FILES])
of_each = pytest.mark.parametrize("one", TABLE, ids=lambda one: one.name)


class Seen(NamedTuple):
    """What was known of a file when its dialect was determined: the arguments of `dialect_of`."""

    names: Sequence[str]
    facts: Facts
    tag: str
    fields: int

    @property
    def columns(self) -> Sequence[str]:
        """Return the names of the file's columns, and the labels of numbers in other lines of the file. If
        there are no names and labels, return the columns' positions.
        """
        return (*self.names, *self.facts.beside) or [str(place + 1) for place in range(self.fields)]

    def dialect(self) -> Dialect | None:
        return dialect_of(self.names, self.facts, tag=self.tag, fields=self.fields)

    def all(self) -> list[Dialect]:
        """Return all dialects of the table that match the file, not only the first one that matches."""
        return [one for one in TABLE if dialects._is_in(one, self.names, self.facts, self.tag, self.fields)]


@cache
def seen(name: str) -> Seen:
    """Read an example file, and return what was known of it when its dialect was determined."""
    calls: list[Seen] = []

    def watched(names: Sequence[str], facts: Facts, *, tag: str = "", fields: int = 0) -> Dialect | None:
        facts = facts._replace(sample=partial(np.copy, facts.sample()))
        calls.append(Seen(tuple(names), facts, tag, fields))
        return dialect_of(names, facts, tag=tag, fields=fields)

    path, how = HERE / name, how_of(OPTIONS[name])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(columns, "dialect_of", watched)
        try:
            if name in APART:
                sheet = with_sample(loaded(FORMATS[APART[name]].reader)(path, ""))
                open_sheet(path, sheet, how, DEFAULT_LIMITS)
            else:
                open_csv(path, how)
        except UsageError:
            assert any(one.unread for one in TABLE if name in one.corpus)
    return calls[-1]


def patterns(one: Dialect) -> list[str]:
    """Return all regular expressions of a dialect."""
    triples = [pattern for triple in (*one.gyro, *one.accel) for pattern in triple]
    return [*one.names, *one.head, one.tag, one.file, one.rate, one.sensor, *one.no_time, *triples, *one.time]


@of_each
def test_a_row_can_be_used(one: Dialect) -> None:
    for pattern in patterns(one):
        re.compile(pattern)
    assert not one.rate or re.compile(one.rate).groups == 1
    assert one.names or one.tag or one.fields, "nothing recognises it"
    assert not one.gyro_unit or rate_unit(one.gyro_unit), "no unit of rates"
    assert not one.accel_unit or accel_unit(one.accel_unit)
    assert not one.time_unit or time_unit(one.time_unit) == one.time_unit
    for unit, when in one.ask_unit.items():
        assert parse_units(unit)
        assert when
    assert not (one.gyro_unit and one.ask_unit), "it says a unit, and asks for it"
    assert bool(one.unread) != bool(one.gyro)
    assert not (one.gyro_scale or one.time_scale or one.accel_scale) or one.head, "scales stand in a head"


@of_each
def test_a_row_says_where_its_form_is_documented(one: Dialect) -> None:
    assert re.search(
        r"\w\.(?:org|com|net|de|ca|uk|io|cc|edu|ch|xyz)\b|manual|user guide|AN\d{4}|pymavlink", one.docs
    )
    assert len(one.docs) > 30
    assert not one.docs.endswith(".")


def test_names_are_used_once() -> None:
    for what in ("name", "guide"):
        found = [getattr(one, what) for one in TABLE]
        assert len({*found}) == len(found)


@of_each_file
def test_the_file_of_a_row_is_in_it_and_has_its_columns(one: Dialect, name: str) -> None:
    found = seen(name)
    assert found.dialect() is one
    if one.unread:
        return
    assert columns_of(one.gyro, found.columns)
    times = [re.sub(r"(\d+)\+\d+", r"\1", pattern) for pattern in one.time]
    times = [pattern for pattern in times if columns_of([[pattern]], found.columns)]
    rate = re.search(one.rate, found.facts.head, re.M) if one.rate else stated_in(found.facts.head).rates
    assert times or rate or "--rate" in pairs(OPTIONS[name]) or "sec" in " ".join(found.names)
    for scale in filter(None, (one.gyro_scale, one.time_scale, one.accel_scale)):
        assert found.facts.number(scale)
    assert not one.sensor or columns_of([[one.sensor]], found.columns)


@of_each
def test_each_column_of_a_row_is_in_one_of_its_files(one: Dialect) -> None:
    """Without this test, a mistyped name in the table would never be noticed."""
    files = [seen(name).columns for name in one.corpus if (one, name) in FILES]
    has_accel = any(accel_axis_of(name) for names in files for name in names) or not one.names
    assert not (one.accel and has_accel) or any(columns_of(one.accel, names) for names in files)
    for pattern in one.names:
        assert any(re.fullmatch(pattern, name) for names in files for name in names)


@of_each_file
def test_of_several_rows_for_a_file_the_special_one_stands_first(one: Dialect, name: str) -> None:
    """The first row of the table (a dialect) that matches a file is used, so a special one has to stand
    before a more general one. A later row is more general if the first row does not match all of its example
    files.
    """
    first, *others = seen(name).all()
    assert first is one
    for other in others:
        assert any(one not in seen(file).all() for file in other.corpus if (other, file) in FILES), other.name


def without_a_fact(one: Dialect, found: Seen) -> Iterator[tuple[str, Seen]]:
    """Yield what is known of a file, without one of the facts by which its dialect is recognised. Each fact
    is missing once.
    """
    for pattern in one.names:
        names, beside = (
            tuple(name for name in some if not re.fullmatch(pattern, name))
            for some in (found.names, found.facts.beside)
        )
        yield f"names: {pattern}", found._replace(names=names, facts=found.facts._replace(beside=beside))
    for pattern in one.head:
        head = re.sub(pattern, "", found.facts.head, flags=re.M)
        yield f"head: {pattern}", found._replace(facts=found.facts._replace(head=head))
    if one.tag:
        yield "tag", found._replace(tag="$OTHER")
        yield "no tag", found._replace(tag="")
    if one.fields:
        yield "one field more", found._replace(fields=found.fields + 1)
        yield "one field less", found._replace(fields=found.fields - 1)
    if one.file:
        yield "file", found._replace(facts=found.facts._replace(file="recording"))
    if not (one.names or one.head or one.tag or one.file):
        for factor in (0.0, 1 / 9.80665, 1000.0, np.nan):
            facts = found.facts._replace(sample=partial(np.copy, found.facts.sample() * factor))
            yield f"gravity times {factor:.3g}", found._replace(facts=facts)
        yield "no rows", found._replace(facts=found.facts._replace(sample=partial(np.empty, (0, one.fields))))


@of_each_file
def test_without_any_one_fact_it_is_not_recognised_nor_taken_for_another(one: Dialect, name: str) -> None:
    whole = seen(name)
    lacking = [*without_a_fact(one, whole)]
    assert lacking
    for what, found in lacking:
        other = found.dialect()
        assert other is not one, what
        # Without the fact, the file may match another, more general dialect. That dialect has to give the
        # same unit or none. It must also name the columns of the gyroscope, or say that its files are not
        # read.
        if other is not None and not one.unread:
            assert other.gyro_unit in ("", one.gyro_unit), (what, other.name)
            assert bool(other.unread or other.gyro)


@of_each
def test_what_it_cannot_say_is_asked_with_the_circumstances(one: Dialect) -> None:
    if one.ask_unit:
        name = next(iter(one.corpus))
        options = {flag: value for flag, value in pairs(OPTIONS[name]).items() if flag != "--units"}
        with pytest.raises(UsageError) as caught:
            open_csv(HERE / name, how_of(" ".join(f"{flag} {value}" for flag, value in options.items())))
        shown = [line for line in str(caught.value).split("\n") if line.startswith("  --units ")]
        assert len(shown) == len(one.ask_unit)
        for line, (unit, when) in zip(shown, one.ask_unit.items(), strict=True):
            assert line.startswith(f"  --units {unit} ")
            assert line.endswith(f"  ({when})")


@of_each_file
def test_another_order_of_columns_is_the_same_dialect(one: Dialect, name: str) -> None:
    found = seen(name)
    if found.names:
        assert found._replace(names=found.names[::-1]).dialect() is one


def test_names_alone_of_what_is_in_no_dialect() -> None:
    for names in (["t", "gx", "gy", "gz"], ["x", "y", "z"], ["time", "x", "y", "z"], ["gyro_x_dps"], []):
        assert dialect_of(names, Facts(file="rest.csv"), fields=len(names) or 3) is None


def test_a_table_of_a_million_columns_is_not_compared_with_each_dialect() -> None:
    names = [*seen("gopro.csv").names, *(f"c{k}" for k in range(MOST_NAMES))]
    assert dialect_of(names, seen("gopro.csv").facts) is None


@pytest.mark.parametrize(
    ("head", "number"),
    [
        ("tscale,0.001", 0.001),
        ("vid,1\n  tscale: 1e-3\nx", 1e-3),
        ("# tscale = .5", 0.5),
        ("tscale;-2", -2.0),
        ("mytscale,0.001", None),
        ("tscales,0.001", None),
        ("tscale,fast", None),
        ("", None),
    ],
)
def test_numbers_of_a_head(head: str, number: float | None) -> None:
    assert Facts(head=head).number("tscale") == number


def test_two_columns_of_one_axis_are_a_doubt() -> None:
    """Two columns that match the same axis are ambiguous, unless the prefix of one sensor's column names
    distinguishes them.
    """
    assert columns_of([["a", "b", "c"], ["p|q", "r", "s"]], ["s", "r", "q"]) == (2, 1, 0)
    assert columns_of([["a", "b", "c"]], ["a", "b"]) == ()
    assert columns_of([["p|q", "r", "s"]], ["p", "q", "r", "s"]) == ()
    names = ["S_1_t", "S_1_x", "S_1_y", "S_1_z", "S_12_t", "S_12_x", "S_12_y", "S_12_z"]
    assert columns_of([[".*_x", ".*_y", ".*_z"]], names) == ()
    assert columns_of([[".*_x", ".*_y", ".*_z"]], names, "S_12_") == (5, 6, 7)
    assert columns_of([[".*_t"]], names, "S_1_") == (0,)
