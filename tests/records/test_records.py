"""The reference documents every field of every record that the code can emit, and nothing else."""

import typing
from pathlib import Path

import msgspec
import pytest
from fltea.records.records import (
    AXES,
    AnyRecord,
    DeviceEstimates,
    DeviceFits,
    EpochReason,
    Estimate,
    FlteaEstimate,
    Hello,
    Sample,
    Whiteness,
    WhyNot,
)
from fltea.wire import layout as wire
from fltea.wire.messages import REASONS
from host_support import QUICK, ROOT, fltea_here, strict_records

REFERENCE = ROOT / "host/docs/reference"
KINDS = {kind.__struct_config__.tag: kind for kind in typing.get_args(AnyRecord)}


# --- what the code can emit ---


SYNTHETIC = ("-s", "synthetic:?n=300")


def emitted_fields(struct: type[msgspec.Struct]) -> dict[str, bool]:
    """Path of every field to whether it can be null; keys of a dict are <axis>, <output>, <t> or <reason>."""
    info = msgspec.inspect.type_info(struct)
    assert isinstance(info, msgspec.inspect.StructType)
    tag = {info.tag_field: False} if info.tag_field else {}
    return tag | _fields_of(info)


def _fields_of(info: msgspec.inspect.StructType) -> dict[str, bool]:
    found: dict[str, bool] = {}
    for field in info.fields:
        found |= _paths(field.encode_name, field.type)
    return found


def _paths(path: str, kind: msgspec.inspect.Type) -> dict[str, bool]:
    kinds = kind.types if isinstance(kind, msgspec.inspect.UnionType) else (kind,)
    nullable = any(isinstance(one, msgspec.inspect.NoneType) for one in kinds)
    found: dict[str, bool] = {}
    for one in kinds:
        if isinstance(one, msgspec.inspect.StructType):
            found |= {f"{path}.{name}": null for name, null in _fields_of(one).items()}
        elif isinstance(one, msgspec.inspect.DictType):
            objects = isinstance(one.value_type, msgspec.inspect.StructType | msgspec.inspect.DictType)
            by_axis = objects or path == "restarts"
            by_time = isinstance(one.key_type, msgspec.inspect.IntType)
            key = "<output>" if path == "outputs" else "<axis>" if by_axis else "<reason>"
            key = "<t>" if by_time else key
            found |= _paths(f"{path}.{key}", one.value_type)
    return {path: nullable} | found if nullable or not found else found


# --- what the page says ---


def tables(section: str) -> dict[str, dict[str, list[str]]]:
    """Title of a table's first column to its rows: first cell without backticks, the other cells."""
    found: dict[str, dict[str, list[str]]] = {}
    title = None
    for line in section.splitlines():
        if not line.startswith("|"):
            title = None
            continue
        first, *others = (cell.strip() for cell in line.strip("|").split("|"))
        if title is None:
            title = first
            assert title not in found, f"two tables of '{title}' in one section"
            found[title] = {}
        elif first.strip("-: "):
            assert first.startswith("`"), f"'{first}' is not in backticks"
            for name in expanded(first.strip("`")):
                assert name not in found[title], f"{name} is documented twice"
                found[title][name] = others
    return found


def expanded(name: str) -> list[str]:
    """`a.{b,c}` is `a.b` and `a.c`."""
    before, brace, rest = name.partition("{")
    if not brace:
        return [name]
    inside, _, after = rest.partition("}")
    return [before + one + end for one in inside.split(",") for end in expanded(after)]


def documented() -> dict[str, dict[str, dict[str, list[str]]]]:
    """Class of a record to the tables of its section."""
    parts = (REFERENCE / "records.md").read_text(encoding="utf-8").split("\n## ")[1:]
    found = {part.partition("\n")[0].strip().strip("`"): tables(part) for part in parts}
    errors = (REFERENCE / "errors.md").read_text(encoding="utf-8").partition("\n## ")[0]
    in_all = found.pop("In all records")["field"]
    found["error"] = tables(errors)
    for kind, section in found.items():
        known = emitted_fields(KINDS[kind]) if kind in KINDS else {}
        section["field"] = {name: row for name, row in in_all.items() if name in known} | section["field"]
    return found


def compare(what: str, in_code: set[str], on_page: set[str]) -> None:
    missing, surplus = sorted(in_code - on_page), sorted(on_page - in_code)
    text = [f"{what}: the code emits it, the page does not say so: {', '.join(missing)}"] if missing else []
    text += [f"{what}: the page says so, the code never emits it: {', '.join(surplus)}"] if surplus else []
    if text:
        pytest.fail("\n".join(text))


def test_every_class_of_record_has_its_section() -> None:
    compare("class", set(KINDS), set(documented()))


@pytest.mark.parametrize("kind", KINDS)
def test_every_field_is_documented(kind: str) -> None:
    compare(kind, set(emitted_fields(KINDS[kind])), set(documented()[kind]["field"]))


@pytest.mark.parametrize("kind", KINDS)
def test_page_says_which_fields_can_be_null(kind: str) -> None:
    rows = documented()[kind]["field"]
    null_in_code = {path for path, nullable in emitted_fields(KINDS[kind]).items() if nullable}
    compare(f"{kind}, 'or null'", null_in_code, {path for path, (of, *_) in rows.items() if "null" in of})


def test_every_word_that_a_field_can_hold_is_documented() -> None:
    page = documented()
    cases = [
        (page["epoch"]["field"]["reason"], typing.get_args(EpochReason)),
        (page["device_estimate"]["field"]["axes.<axis>.why_not"], typing.get_args(WhyNot)),
        (page["hello"]["field"]["sampling_mode"], [mode.name.lower() for mode in wire.SamplingMode]),
        (page["estimate"]["field"]["axes.<axis>.whiteness"], typing.get_args(Whiteness)),
        (page["stats"]["field"]["board.reset_cause"], [cause.name.lower() for cause in wire.ResetCause]),
    ]
    for (_, meaning), words in cases:
        for word in words:
            assert f"`{word}`" in meaning


def test_reasons_are_those_of_the_protocol_page() -> None:
    page = (ROOT / "protocol/README.md").read_text(encoding="utf-8")
    for reason in REASONS:
        assert f"\n| {reason} |" in page


# --- a real run says nothing else ---

CONSTANT = "time_s,gyro_x_dps,gyro_y_dps\n" + "".join(f"{k / 100},{k % 7},1\n" for k in range(200) if k != 99)


def test_real_run_emits_only_what_its_structs_say(tmp_path: Path) -> None:
    (tmp_path / "rest.csv").write_text(CONSTANT)
    runs = [
        fltea_here("run", *SYNTHETIC, "--pace", "fast", "--once", "--samples", "--corrected", *QUICK),
        fltea_here("run", "-s", f"replay:{tmp_path}/rest.csv", "--once", "--samples", *QUICK),
    ]
    found = [record for run in runs for record in strict_records(run.stdout)]
    # What a device makes by itself is in runs of test_device_estimates_outputs.py and test_device_fits.py.
    assert {type(record) for record in found} == set(KINDS.values()) - {DeviceEstimates, DeviceFits}
    for run in runs:
        assert "NaN" not in run.stdout
        assert "Infinity" not in run.stdout


def test_invalid_axis_is_null_and_the_others_go_on(tmp_path: Path) -> None:
    (tmp_path / "rest.csv").write_text(CONSTANT)
    run = fltea_here("run", "-s", f"replay:{tmp_path}/rest.csv", "--once", *QUICK)
    found = strict_records(run.stdout)
    assert isinstance(found[0], Hello)
    assert not any(isinstance(record, Sample) for record in found)
    estimates = [record for record in found if isinstance(record, Estimate)]
    assert len(estimates) == 149
    for record in estimates:
        assert [*record.axes] == list(AXES[:2])
        assert record.axes["gyro_x"].fltea.valid
        assert record.axes["gyro_y"].fltea == FlteaEstimate()
        assert record.axes["gyro_y"].null_p is None
