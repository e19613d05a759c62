"""What the site says is true: commands, options and settings, and all that is written from the code."""

import os
import re
import shlex
import sys
import textwrap
import tomllib
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
import site_reference
import yaml
from command_tree import command_tree
from fltea.recording.npz_file import open_npz
from fltea.records.records import AnyRecord, Epoch
from fltea.settings.config import Config
from host_support import ROOT
from site_pages import sections

DOCS = ROOT / "host/docs"
PAGES = sorted(DOCS.rglob("*.md"))
TEXTS = [
    "README.md",
    "CHANGELOG.md",
    *sorted(
        file.relative_to(ROOT).as_posix()
        for folder in ("host", "firmware", "protocol", "tests", "tools")
        for file in (ROOT / folder).rglob("*.md")
    ),
]
"""All that people read, where it stands: links of the site itself are checked when it is built."""
FLAGS = {
    command.name.partition(" ")[2]: {name for flag in command.options for name in flag.names}
    for command in command_tree().commands
}


def code(page: Path) -> Iterator[str]:
    """Lines of code: fenced, or indented after an empty line."""
    fenced = False
    for line in page.read_text(encoding="utf-8").splitlines():
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif fenced or line.startswith("    "):
            yield line.strip()


@pytest.mark.parametrize("text", TEXTS)
def test_commands_in_a_text_exist_with_their_options(text: str) -> None:
    for line in code(ROOT / text):
        for command in line.split(" | "):
            try:
                words = shlex.split(command.replace("; fltea ", " # "), comments=True)
            except ValueError:  # no line of a shell
                continue
            if words[:1] not in (["fltea"], [".venv/bin/fltea"]) or len(words) < 2:
                continue
            assert words[1] in FLAGS, line
            for word in words[2:]:
                flag = word.partition("=")[0]
                assert not re.match(r"--?[A-Za-z]", flag) or flag in FLAGS[words[1]], line


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_settings_on_a_page_are_not_refused(page: Path) -> None:
    for block in re.findall(
        r"^ *```toml\n(.*?)^ *```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    ):
        msgspec.convert(tomllib.loads(block), Config)


@pytest.mark.parametrize("text", TEXTS)
def test_links_lead_to_a_file_and_a_heading_of_it(text: str) -> None:
    file = ROOT / text
    content = re.sub(r"```.*?```|`[^`\n]*`", "", file.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^()\s]+)\)", content):
        if re.match(r"[a-z]+:", target) or target == "records.schema.json":  # which the site writes
            continue
        path, _, anchor = target.partition("#")
        there = file.parent / path if path else file
        assert there.exists(), target
        if anchor:
            assert anchor in {one.anchor for one in sections(there.read_text(encoding="utf-8"))}, target


@pytest.mark.slow
def test_the_notebook_runs_as_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (DOCS / "cookbook/notebook.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    noise = np.random.default_rng(1).normal(0.0, 0.05, (2000, 1))
    np.savetxt(tmp_path / "rest.csv", noise, header="x", comments="")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
    exec(block, {})
    assert capsys.readouterr().out.startswith("gyro_x White noise. A filter needs its density only")


def test_samples_of_a_linux_driver_become_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (DOCS / "cookbook/iio.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^ *```python\n(.*?)^ *```", page, re.MULTILINE | re.DOTALL)
    counts = np.arange(3000, dtype="<i2").reshape(-1, 3)
    (tmp_path / "rest.bin").write_bytes(counts.tobytes())
    monkeypatch.chdir(tmp_path)
    exec(textwrap.dedent(block), {})
    recording = open_npz(tmp_path / "rest.npz").whole()
    assert recording.rate_hz == 200.0
    assert recording.lsb_per_dps is not None
    np.testing.assert_allclose(recording.gyro / recording.lsb_per_dps, np.degrees(counts * 0.001065))


def test_every_page_is_in_the_navigation_once() -> None:
    def files(part: object) -> Iterator[str]:
        if isinstance(part, str):
            yield part
        elif isinstance(part, dict | list):
            for below in part.values() if isinstance(part, dict) else part:
                yield from files(below)

    settings = yaml.safe_load((ROOT / "host/mkdocs.yml").read_text(encoding="utf-8"))
    assert sorted(files(settings["nav"])) == [page.relative_to(DOCS).as_posix() for page in PAGES]


def test_every_command_and_option_is_in_the_reference() -> None:
    text = site_reference.commands()
    for name, flags in FLAGS.items():
        section = text.split(f"\n## fltea {name}\n")[1].split("\n## ")[0]
        assert all(f"`{flag}`" in section for flag in flags), name


def test_every_setting_is_in_the_reference_with_its_default() -> None:
    text = site_reference.settings()
    for name in ("link.max_gap", "estimator.joint.beta0", "live.target", "mqtt.broker", "source"):
        assert text.count(f"| `{name}` |") == 1
    assert "| `live.target` | number | `0.05` | Half the width of α's interval" in text
    assert '`"auto"`' in text
    assert "Seconds of samples between fits; unset: 1, but" in text


def test_a_docstring_gives_each_setting_its_meaning() -> None:
    class Base(msgspec.Struct):
        """All. a: the first; None: none. b, c: both of them."""

        a: int | None = None
        b: int = 1

    class Below(Base):
        """More.

        c: another. `d`: no setting.
        """

        c: int = 2

    assert site_reference.explained(Below) == {
        "a": "The first; unset: none.",
        "b": "Both of them.",
        "c": "Another. `d`: no setting.",
    }


def test_the_schema_of_records_describes_them() -> None:
    schema = msgspec.json.decode(site_reference.schema())
    assert schema["$defs"]["Epoch"]["properties"]["class"] == {"enum": ["epoch"]}
    assert set(schema["$defs"]["Epoch"]["required"]) <= set(Epoch.__struct_fields__) | {"class"}
    kinds = {kind.__name__ for kind in AnyRecord.__args__}
    assert kinds <= set(schema["$defs"])


def test_modules_below_the_api_exist() -> None:
    for name in site_reference.DEEPER:
        assert (ROOT / "host" / (name.replace(".", "/") + ".py")).is_file(), name


def test_texts_that_a_help_text_names_become_links() -> None:
    assert site_reference.linked("host/README.md says it; firmware/README.md: more.") == (
        "[host/README.md](../../../host/README.md#records) says it; "
        "[firmware/README.md](../../../firmware/README.md): more."
    )


def test_a_cell_stays_one() -> None:
    assert site_reference.cell("a | b\n<c>") == "a \\| b &lt;c>"
    assert "|" not in site_reference.code("a|b")
