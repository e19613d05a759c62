"""Tests that each field of a record that has a default is set by some code. Otherwise the field would always
be empty.
"""

import ast
import re
import typing
from collections.abc import Iterator
from pathlib import Path

import msgspec
from fltea.archive.info import as_json, summarise
from fltea.records.records import AnyRecord
from fltea.records.stats import SampleStats
from fltea.stream.decode import Decoder

from tests.rig.host_support import ROOT

MOST = 30
"""A number larger than the number of fields of any record.

A call with `*arguments` may set any number of fields. It counts as a call with this many arguments.
"""

Fields = set[tuple[str | None, str | int]]
"""Arguments of calls in the host's code: for a positional argument, the name of what is called and the
argument's position; for a keyword argument, None and the argument's name.
"""


def arguments(source: str) -> Iterator[tuple[str | None, str | int]]:
    """Yield all arguments of all calls in source code, each as in `Fields`."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            yield from ((None, one.arg) for one in node.keywords if one.arg)
            called = node.func.id if isinstance(node.func, ast.Name) else ""
            is_open = any(isinstance(one, ast.Starred) for one in node.args)
            yield from ((called, place) for place in range(MOST if is_open else len(node.args)))


def structs(hint: object, found: set[type[msgspec.Struct]]) -> set[type[msgspec.Struct]]:
    """Add all record types in a type hint, and those of their fields, to `found`. Return `found`."""
    for part in typing.get_args(hint):
        structs(part, found)
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct) and hint not in found:
        found.add(hint)
        for one in typing.get_type_hints(hint).values():
            structs(one, found)
    return found


def unfilled(given: Fields) -> list[str]:
    return sorted(
        f"{struct.__name__}.{field.name}"
        for struct in structs(AnyRecord, set())
        for place, field in enumerate(msgspec.structs.fields(struct))
        # native code fills SampleStats, which a test of its own compares with it
        if struct is not SampleStats
        and not field.required
        and not {(None, field.name), (struct.__name__, place)} & given
    )


def given_in(folder: Path) -> Fields:
    """Return the arguments of all calls in the files that make a record or a part of one.

    The code of the outputs (`sinks`) does not count, since it only reads records.
    """
    files = (file for file in folder.rglob("*.py") if "sinks" not in file.parts)
    names = re.compile("|".join(rf"\b{struct.__name__}\(" for struct in structs(AnyRecord, set())))
    sources = (file.read_text(encoding="utf-8") for file in files)
    return {one for source in sources if names.search(source) for one in arguments(source)}


def test_some_code_gives_each_field_of_a_record_a_value() -> None:
    given = given_in(ROOT / "host/fltea")
    assert not unfilled(given), (
        f"no code of host/fltea gives {unfilled(given)} a value: fill it in host/fltea/stream, or remove it"
    )


def test_a_source_gives_each_count_of_the_connection_a_value() -> None:
    """Every count in `LinkStats` gets its value in the source, not in the code that processes samples. `fltea
    info` uses only the source, so a count that other code fills would be shown as 0.
    """
    missing = [one for one in unfilled(given_in(ROOT / "host/fltea/sources")) if one.startswith("LinkStats.")]
    assert not missing, (
        f"no source gives {missing} a value, so `fltea info` would publish its default. A number that is "
        "made of samples belongs in SampleStats, which host/fltea/stream/decode.py fills for both"
    )


def test_native_code_gives_each_count_of_samples() -> None:
    counts = Decoder(lambda: 0, 100).native.counts.keys()
    wanted = {*SampleStats.__struct_fields__}
    assert not wanted - counts, f"PlaceCounts in host/native/sequence_tracker.hpp lacks {wanted - counts}"
    assert not counts - wanted, f"SampleStats in host/fltea/records/stats.py lacks {counts - wanted}"


def test_fltea_info_prints_each_count_of_samples_as_a_field_of_its_own() -> None:
    path = ROOT / "tests/recording/corpus/euroc.csv"
    found = msgspec.json.decode(as_json(summarise([path], 100)))
    names = {"delivered": "samples"}
    missing = {names.get(name, name) for name in SampleStats.__struct_fields__} - found.keys()
    assert not missing, f"`fltea info` lacks {missing} of SampleStats: host/fltea/archive/info.py, as_json"
    assert (found["class"], found["gaps"], found["samples"] > 0) == ("recording", 0, True)
    assert [*found].index("samples") == [*found].index("duration_s") + 1


def test_a_field_that_nobody_fills_is_seen() -> None:
    assert "Stats.fit_period_s" in unfilled(set())
    assert "TrackerStats.bias" not in unfilled({(None, "bias")})
