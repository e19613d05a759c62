"""What the site says is true: commands, options and settings, and all that is written from the code."""

import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import site_reference
import yaml
from command_tree import command_tree
from fltea.records.records import AnyRecord, Epoch
from fltea.settings.config import Config
from host_support import ROOT

DOCS = ROOT / "host/docs"
PAGES = sorted(DOCS.rglob("*.md"))
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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_commands_on_a_page_exist_with_their_options(page: Path) -> None:
    for line in code(page):
        words = shlex.split(line, comments=True)
        if words[:1] != ["fltea"]:
            continue
        assert words[1] in FLAGS, line
        for word in words[2:]:
            flag = word.partition("=")[0]
            assert not re.match(r"--?[A-Za-z]", flag) or flag in FLAGS[words[1]], line


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_settings_on_a_page_are_taken(page: Path) -> None:
    for block in re.findall(
        r"^ *```toml\n(.*?)^ *```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    ):
        msgspec.convert(tomllib.loads(block), Config)


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


def test_a_cell_stays_one() -> None:
    assert site_reference.cell("a | b\n<c>") == "a \\| b &lt;c>"
    assert "|" not in site_reference.code("a|b")
