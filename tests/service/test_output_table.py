"""Tests that the table of outputs is complete.

If a new output lacks an entry, a test's failure says which one, and in which file the entry belongs.
"""

import ast
import importlib
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from fltea.diagnostics import addresses
from fltea.machine.doctor.checks_outputs import check_outputs
from fltea.records.errors import UsageError
from fltea.service.hub import Hub
from fltea.service.open_outputs import open_outputs
from fltea.settings.config import SETTINGS, Config, load_config, load_configs
from fltea.settings.outputs import OUTPUTS, Output, Outputs
from fltea.sinks import opening
from fltea.sinks.opening import Opening, OutputModule
from fltea.sources.open_source import check_shared

from tests.rig.fake_system import FakeSystem
from tests.rig.host_support import ROOT, closed
from tests.rig.memory_sink import Memory
from tests.rig.outputs import EACH_OUTPUT, MISSING, switched_on
from tests.rig.signatures import lacking
from tools import site_outputs

SINKS = ROOT / "host/fltea/sinks"
NO_OUTPUTS = {"output", "state"}
"""Groups of settings in `Outputs` that do not belong to one output: "output" is for all outputs, "state" for
snapshots.
"""
NOT_IN_THE_TABLE = {"log"}
"""Modules with a `Sink` that users cannot choose as an output of its own."""
UNSEEN = {"stdout"}
"""Outputs whose check finds nothing, since nothing can be found out before they are used."""


def sinks() -> Iterator[str]:
    """Yield the name of every module that defines a `Sink`, as it stands in `Output.module`."""
    for file in SINKS.rglob("*.py"):
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and any(ast.unparse(base) == "Sink" for base in node.bases):
                yield ".".join(file.relative_to(SINKS).with_suffix("").parts)


def test_every_output_can_be_switched_on_by_its_setting() -> None:
    """While this test fails, the tests of each output are skipped, since they switch the output on."""
    assert not MISSING, "\n".join(MISSING)


def test_every_table_of_settings_and_every_sink_has_a_row() -> None:
    tables = {output.on.partition(".")[0] for output in OUTPUTS}
    forgotten = [name for name in Outputs.__struct_fields__ if name not in tables | NO_OUTPUTS]
    assert not forgotten, f"settings/outputs.py: OUTPUTS has no row for the settings {forgotten}"
    unused = {*sinks()} - {output.module for output in OUTPUTS} - NOT_IN_THE_TABLE
    assert not unused, f"settings/outputs.py: OUTPUTS has no row for sinks/{unused}"


@EACH_OUTPUT
def test_every_row_has_its_setting_its_sink_and_its_extra(output: Output) -> None:
    assert not output.is_on(Config(format="none"))
    assert output.is_on(load_config(None, {"format": "none"} | switched_on(output)))
    module = importlib.import_module(f"fltea.sinks.{output.module}")
    assert not lacking(module, OutputModule, "open_output", "check_output")
    name = module.open_output.__annotations__["return"].name
    assert name == output.name, f"sinks/{output.module} has the name {name}, its row {output.name}"
    if output.extra:
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        extras = project["optional-dependencies"]
        assert output.extra in extras, f"pyproject.toml has no extra {output.extra}"
        assert re.search(rf"[\[,]{output.extra}[\],]", extras["outputs"][0]), "pyproject.toml: extra outputs"
    assert bool(output.extra) == bool(output.library)


@EACH_OUTPUT
def test_the_doctor_looks_at_every_output_and_a_test_at_what_it_finds(
    output: Output, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(addresses, "CONNECT_S", 0.1)
    config = load_config(None, {"format": "none"} | switched_on(output))
    keys = {finding.check for finding in check_outputs([config], FakeSystem(tmp_path))}
    seen = output.name not in UNSEEN
    assert bool(keys) == seen, f"sinks/{output.module}: check_output yields {keys or 'nothing'}"
    tests = "".join(file.read_text(encoding="utf-8") for file in (ROOT / "tests/machine").glob("test_*.py"))
    untested = {key for key in keys if not re.search(rf'"{key}"[:)]', tests)}
    assert not untested, f"tests/machine: no test expects the finding {untested} of sinks/{output.module}"


def test_no_check_is_made_of_an_output_whose_library_is_not_installed(tmp_path: Path) -> None:
    config = load_config(None, {"format": "none", "record.folder": str(tmp_path / "no/recordings")})
    system = FakeSystem(tmp_path)
    assert list(check_outputs([config], system))
    system.without = {"mcap"}
    assert not list(check_outputs([config], system))


@EACH_OUTPUT
def test_the_page_of_outputs_has_a_section_and_a_row_for_each(output: Output) -> None:
    page = (ROOT / "host/docs/guide/outputs.md").read_text(encoding="utf-8")
    _, heading, section = page.partition(f"\n## {output.section}\n")
    assert heading, f"guide/outputs.md has no section {output.section}"
    table, dot, _ = output.on.partition(".")
    link = f"[Settings](../reference/settings.md#{table})"
    assert not dot or link in section.partition("\n## ")[0], (
        f"guide/outputs.md, {output.section}: no link {link}"
    )
    assert "\n<!-- generated: outputs -->\n" in page
    rows = [line for line in site_outputs.outputs().splitlines() if line.startswith(f"| [`{output.name}`]")]
    assert any(f"`{site_outputs.switch(output)}`" in row for row in rows)


@EACH_OUTPUT
def test_the_list_of_rooms_names_each(output: Output) -> None:
    readme = (ROOT / "host/README.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| `sinks/` \|.*", readme, re.MULTILINE)
    name = output.module.partition(".")[0]
    assert name in row.lower(), f"host/README.md, the rooms: the row of sinks/ does not name {name}"


@EACH_OUTPUT
@pytest.mark.parametrize("shared", [False, True], ids=["", "with a source of many"])
def test_each_is_opened_as_often_as_its_row_says(
    output: Output, shared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[tuple[str, str]] = []

    def load(module: str, *extra: str) -> SimpleNamespace:
        def open_output(of: Opening) -> Memory:
            opened.append((module, of.device))
            return Memory("stdout")

        return SimpleNamespace(open_output=open_output)

    monkeypatch.setattr(opening, "load", load)
    urls = ["synthetic:?seed=1", "synthetic:?seed=2", *(["mqtt://broker.example"] if shared else [])]
    configs = load_configs(None, {"format": "none"} | switched_on(output), urls)
    hub = Hub(lambda error: None)
    open_outputs(configs, hub)
    assert closed(hub)
    names = [config.name or "" for config in configs[:2]]
    expected = {"program": [""], "device": names, "shared source": [""] * shared}[output.each]
    assert [name for module, name in opened if module == f"fltea.sinks.{output.module}"] == expected


@EACH_OUTPUT
def test_sources_of_many_devices_refuse_what_is_for_single_ones(output: Output) -> None:
    settings = {"format": "none", "source": "mqtt://broker.example"} | switched_on(output)
    config = load_config(None, settings)
    if output.of_many:
        check_shared([config])
        return
    with pytest.raises(UsageError, match=f"^{SETTINGS[output.on].setting.flags[0]} does not work"):
        check_shared([config])
