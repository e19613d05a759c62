"""Every setting is declared once. The configuration file, --set, the flags, the documentation and the board's
header agree with the declaration.

These tests iterate over the declarations, so a new setting is tested without a change here.
"""

import ast
import json
import re
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import pytest
import typer.main
from click.testing import CliRunner
from fltea.cli.app import app
from fltea.cli.setting_flags import takes_settings
from fltea.records.errors import UsageError
from fltea.service import daemon
from fltea.settings.config import SETTINGS, TABLES, Config
from fltea.settings.setting import MOST_SHOWN, Declared, Table, shown
from msgspec import inspect as types

from tests.rig.host_support import ROOT
from tools import gen_settings, site_settings

COMMAND: Any = typer.main.get_command(app).commands["run"]  # type: ignore[attr-defined]

ALL = [one for one in SETTINGS.values() if one.default is not None or one.setting.example is not None]
"""All settings. One that has neither a default nor an example is told by
`test_every_field_of_every_table_is_declared`; no other test can give it a value.
"""
BESIDE = {"mqtt.key": 'cert = "client.pem"'}
"""Some settings are accepted only with another line in the same table of the configuration file. For each of
them, this line.
"""


def by_path(one: Declared) -> str:
    return one.path


@pytest.mark.parametrize("one", [one for one in ALL if one.setting.flags], ids=by_path)
def test_a_flag_with_a_value_names_the_value_in_the_help(one: Declared) -> None:
    """Typer itself shows the words of a choice in the help, so only other flags are tested."""
    if not any(isinstance(kind, types.BoolType | types.LiteralType) for kind in one.kinds):
        assert one.setting.metavar, f"{one.path} needs a `metavar` in settings/"


@cache
def read_names() -> set[str]:
    """Return the names that the host reads as attributes, or as the last part of a path (`joint.alpha0`)."""
    found = set()
    for file in (ROOT / "host/fltea").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            match node:
                case ast.Attribute(attr=name, ctx=ast.Load()):
                    found.add(name)
                case ast.Constant(value=str(text)) if re.fullmatch(r"(\w+\.)+\w+", text):
                    found.add(text.rpartition(".")[2])
    return found


@pytest.mark.parametrize("one", ALL, ids=by_path)
def test_some_code_reads_the_setting(one: Declared) -> None:
    name = one.path.rpartition(".")[2]
    assert name in read_names(), f"{one.path} is declared in settings/, and no code reads it"


def another(one: Declared) -> Any:
    """Return a valid value that differs from the setting's default."""
    if one.setting.example is not None:
        return one.setting.example
    found: list[Any] = []
    for kind in one.kinds:
        match kind:
            case types.LiteralType():
                found += kind.values
            case types.BoolType():
                found += [True, False]
            case types.IntType() | types.FloatType():
                number = int if isinstance(kind, types.IntType) else float
                ends = (one.setting.least, one.setting.most)
                found += [number(x) for x in (0.5, 1000, 7, *ends) if abs(x) < 1e300]
            case types.StrType():
                found.append("7 ms" if one.setting.time else "other")
            case types.ListType() | types.VarTupleType():
                found.append(["sample"])
    return next(x for x in found if x != one.default and one.accepts(x))


def wrong(one: Declared) -> list[Any]:
    """Return values of the right type that the setting has to refuse."""
    found: list[Any] = ["neither one nor the other"] * any(
        isinstance(x, types.LiteralType) for x in one.kinds
    )
    if one.setting.text:
        found.append("")
    if one.setting.time:
        found += ["fast", "30", "30 seconds", "-1 s", "1e3 s", "s", "nan s", "9999999999 h"]
    for kind in one.kinds:
        ends = [one.setting.least - 1, one.setting.above, one.setting.most * 2]
        if isinstance(kind, types.IntType):
            found += [int(x) for x in ends if abs(x) < 1e300]
        if isinstance(kind, types.FloatType):
            found += [x for x in (float("nan"), float("inf"), *map(float, ends)) if x != -float("inf")]
    return [x for x in found if not one.accepts(x)]


def plain(value: Any) -> Any:
    return json.loads(msgspec.json.encode(value))


def value_in(config: Config, path: str) -> Any:
    found: Any = config
    for name in path.split("."):
        found = getattr(found, name)
    return found


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that runs `fltea run` up to the start of its work, and returns the configuration.

    The function raises the error with which the command would end.
    """
    configs: list[Config] = []
    monkeypatch.setattr(daemon, "run", configs.extend)

    def run(*arguments: str) -> Config:
        result = CliRunner().invoke(COMMAND, [*arguments])
        if isinstance(result.exception, UsageError):
            raise result.exception
        assert result.exit_code == 0, (arguments, result.output, result.exception)
        return configs.pop()

    return run


def as_toml(value: Any) -> str:
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False)


def ways(one: Declared, value: Any, folder: Path) -> list[tuple[str, list[str]]]:
    """Return a pair for each way to give a setting (file, --set, flag): the words with which an error about
    its value begins, and the arguments of the command.
    """
    table, _, key = one.path.rpartition(".")
    file, beside = folder / "fltea.toml", folder / "beside.toml"
    head = f"[{table}]\n" if table else ""
    beside.write_text(head + BESIDE.get(one.path, ""), encoding="utf-8")
    file.write_text(f"{beside.read_text(encoding='utf-8')}\n{key} = {as_toml(value)}\n", encoding="utf-8")
    found = [["--set", f"{one.path}={as_toml(value)}"]]
    text = ",".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
    if not one.path.startswith("accel.") and not (isinstance(value, str) and text.isdigit()):
        found += [[flag] if value is True else [flag, text] for flag in one.setting.flags]
    line = ("command line:", ["--config", str(beside)])
    return [(f"{file}:", ["--config", str(file)]), *((line[0], line[1] + arguments) for arguments in found)]


def test_every_field_of_every_table_is_declared() -> None:
    for path, table in TABLES.items():
        for name in table.__struct_fields__:
            below = f"{path}.{name}".lstrip(".")
            assert below in SETTINGS or isinstance(getattr(table, name), Table) or below == "device"
    for one in SETTINGS.values():
        assert one.setting.meaning.endswith((".", "?")), one.path
        assert one in ALL, f"settings/: {one.path} has no default, so its `Setting` needs `example=`"


@pytest.mark.parametrize("one", ALL, ids=by_path)
def test_a_setting_can_be_set_in_every_way(one: Declared, told: Any, tmp_path: Path) -> None:
    if one.path == "accel.estimate_on":
        return  # of this setting's values, only `host` is allowed for the accelerometer
    assert value_in(told(), one.path) == (one.default if one.path != "name" else "due")
    value = another(one)
    for _, arguments in ways(one, value, tmp_path):
        found = value_in(told(*arguments), one.path)
        assert plain(found) == plain(value), arguments


@pytest.mark.parametrize("one", [one for one in ALL if wrong(one)], ids=by_path)
def test_a_wrong_value_has_one_error_whichever_way_it_comes(one: Declared, told: Any, tmp_path: Path) -> None:
    for value in wrong(one):
        for origin, arguments in ways(one, value, tmp_path):
            with pytest.raises(UsageError) as caught:
                told(*arguments)
            assert str(caught.value) == f"{origin} {one.path} must be {one.takes}, got {value!r}."
            assert one.unit in str(caught.value)


def test_flags_may_hold_for_both_sensors_and_set_is_of_one() -> None:
    found: dict[str, Any] = {}

    @takes_settings(["estimator.window"], of_both=True)
    def command(settings: dict[str, Any]) -> None:
        found.update(settings)

    command(estimator_window="40", set_=["estimator.R=2"])
    assert found == {"estimator.window": 40, "accel.window": 40, "estimator.R": 2}


def test_the_error_says_setting_range_unit_and_value(told: Any) -> None:
    for path, value, text in (
        ("estimator.gate", "0.5", "must be a number from 1 to 1000 standard deviations, got 0.5."),
        ("accel.state.Q", "-1.0", "must be a number from 0 to 1e+100 (m/s²)², got -1.0."),
        ("replay.rate_hz", "0.0", "must be a number above 0 Hz, got 0.0."),
        ("ingest.replicas", "2", "must be 1, 3 or 5, got 2."),
        (
            "link.max_gap",
            "-1",
            'must be a whole number from 0 to 1000000 samples or a time such as "30 s", got -1.',
        ),
        ("live.memory", "5s", "must be a time such as \"30 s\" from 10 to 31622400 s, got '5s'."),
    ):
        with pytest.raises(UsageError, match=re.escape(f"command line: {path} {text}")):
            told("--set", f"{path}={value}")


@pytest.mark.parametrize("one", ALL, ids=by_path)
def test_a_table_made_in_python_is_checked_too(one: Declared) -> None:
    table = type(TABLES[one.path.rpartition(".")[0]])
    for value in wrong(one):
        with pytest.raises(ValueError, match=rf"^{one.name} must be "):
            table(**{one.name: value})


# --- documents generated from the declarations ---


def test_every_setting_is_in_the_reference_with_its_range_and_default() -> None:
    lines = site_settings.settings().splitlines()
    for one in ALL:
        (line,) = [line for line in lines if line.startswith(f"| `{one.path}` |")]
        _, takes, default, meaning = (part.strip() for part in line.strip("| ").split(" | "))
        assert takes == site_settings.cell(one.takes)
        assert meaning == site_settings.cell(one.setting.meaning)
        if one.default is None:
            assert default == "`unset`"
        else:
            assert json.loads(default.strip("`")) == plain(one.default)


def test_the_file_in_the_reference_has_every_default() -> None:
    block = (ROOT / gen_settings.TOML).read_text(encoding="utf-8")
    assert msgspec.convert(tomllib.loads(block), Config) == Config()
    whole = re.sub(r"(?m)^# (?=\w+ = )", "", block)
    found = msgspec.convert(tomllib.loads(whole), Config)
    for one in ALL:
        if one.default is None and not one.path.startswith("accel."):
            assert plain(value_in(found, one.path)) == plain(one.setting.example)


def test_the_boards_header_has_the_same_defaults() -> None:
    header = (ROOT / gen_settings.CPP).read_text(encoding="utf-8")
    numbers = dict(re.findall(r"constexpr (?:float|uint16_t) k(\w+) = (.*?)f?;", header))
    for one in ALL:
        words = one.path.split(".")
        name = "".join(w[0].upper() + w[1:] for part in words[1:] for w in part.split("_"))
        if one.setting.board and words[0] != "accel" and not isinstance(one.default, str):
            assert float(numbers.pop(name)) == one.default
    assert not numbers
    assert f"#define FLTEA_VARIANT {SETTINGS['estimator.variant'].default}\n" in header
    assert f"kGuard = EstimatorGuard::{SETTINGS['estimator.guard'].default};" in header


def test_a_wrong_value_is_repeated_up_to_a_length() -> None:
    assert shown("x" * (MOST_SHOWN - 2)) == repr("x" * (MOST_SHOWN - 2))
    assert shown("x" * (MOST_SHOWN - 1)) == repr("x" * (MOST_SHOWN - 1))[:-1] + "…"
