"""The site's texts are true: commands, options and settings, and all text generated from the code."""

import itertools
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
import typer.main
from fltea.cli.app import app
from fltea.recording.npz_file import open_npz
from fltea.records.records import AnyRecord, Epoch
from fltea.settings.config import Config
from fltea.wire.sensors import SENSORS
from pymdownx.slugs import slugify

from tests.rig.emulated_chips import FIRST
from tests.rig.host_support import ROOT, fltea
from tools import site_hooks, site_records, site_settings

DOCS = ROOT / "host/docs"
PAGES = sorted(DOCS.rglob("*.md"))
TEXTS = [
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    *sorted(
        file.relative_to(ROOT).as_posix()
        for folder in ("findings", "firmware", "host", "protocol", "tests", "tools")
        for file in (ROOT / folder).rglob("*.md")
    ),
]
"""All texts for people. Building the site (`make docs`) checks the links of its own pages."""
INCLUDED = ("firmware/README.md", "protocol/README.md", "host/README.md")
"""Files that are also pages of the site, or parts of pages."""
FLAGS = {
    name: {
        flag
        for one in command.params
        if one.param_type_name == "option" and not one.hidden
        for flag in (*one.opts, *one.secondary_opts)
    }
    for name, command in typer.main.get_command(app).commands.items()
}
FENCED = re.compile(r"^ *(```|~~~).*?^ *\1", re.MULTILINE | re.DOTALL)


def anchors(text: Path) -> set[str]:
    """Return the headings' anchors, as GitHub and the site make them."""
    headings = re.findall(r"^#+ +(.*?) *$", FENCED.sub("", text.read_text(encoding="utf-8")), re.MULTILINE)
    return {slugify(case="lower")(heading.replace("`", ""), "-") for heading in headings}


def code(page: Path) -> Iterator[str]:
    """Return lines of code: fenced, or indented after an empty line."""
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
            except ValueError:  # Not a shell command: a quote is not closed.
                continue
            if words[:1] not in (["fltea"], [".venv/bin/fltea"]) or len(words) < 2:
                continue
            assert words[1] in FLAGS, line
            for word in words[2:]:
                flag = word.partition("=")[0]
                assert not re.match(r"--?[A-Za-z]", flag) or flag in FLAGS[words[1]], line


FOUND = {
    "guide/files.md": "Excel, gzip, PX4, Betaflight, phyphox, Sensor Logger, BNO055, MATLAB",
    "guide/outputs.md": "Home Assistant, Grafana, Prometheus, Foxglove",
    "guide/running.md": "Docker, Podman",
    "guide/raspberry_pi.md": ", ".join(
        ["Raspberry Pi", *(SENSORS[who_am_i].name for who_am_i in FIRST.values())]
    ),
    "guide/verdict.md": "data sheet",
    "cookbook/text.md": "ESP32, Arduino, BNO055, LSM6DS3",
    "cookbook/iio.md": "IIO, MPU-6050",
    "cookbook/notebook.md": "Jupyter",
    "cookbook/allan.md": "allan_variance_ros, imu_utils",
    "cookbook/compare.md": "compare",
    "cookbook/kalibr.md": "Kalibr, noise density",
    "cookbook/which_figure.md": "EKF2, robot_localization, noise density, ArduPilot, GTSAM, KF-GINS",
    "cookbook/vins.md": "VINS",
    "cookbook/ros.md": "ROS 2",
}
"""Search terms, by the page that the search has to find."""


@pytest.mark.parametrize(
    ("page", "word"), [(page, word) for page in FOUND for word in FOUND[page].split(", ")]
)
def test_what_people_search_for_is_found(page: str, word: str) -> None:
    """The site's search finds words in a page's text, not those in a link's address."""
    text = re.sub(r"\]\([^)]*\)", "]", (DOCS / page).read_text(encoding="utf-8"))
    assert re.search(rf"\b{re.escape(word)}\b", text, re.IGNORECASE)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_settings_on_a_page_are_not_refused(page: Path) -> None:
    for block in re.findall(
        r"^ *```toml\n(.*?)^ *```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    ):
        msgspec.convert(tomllib.loads(block), Config)


@pytest.mark.parametrize("text", [text for text in TEXTS if not text.startswith("host/docs/")])
def test_links_lead_to_a_file_and_a_heading_of_it(text: str) -> None:
    file = ROOT / text
    content = re.sub(r"```.*?```|`[^`\n]*`", "", file.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^()\s]+)\)", content):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        there = file.parent / path if path else file
        assert there.exists(), target
        if anchor:
            assert anchor in anchors(there), target


@pytest.mark.slow
def test_the_notebook_runs_as_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (DOCS / "cookbook/notebook.md").read_text(encoding="utf-8")
    _first, _sketch, block = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    noise = np.random.default_rng(1).normal(0.0, 0.05, (2000, 1))
    np.savetxt(tmp_path / "rest.csv", noise, header="x", comments="")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
    exec(block, {})
    assert capsys.readouterr().out.startswith("gyro_x White noise. A filter needs only its density N")


def test_the_first_lines_of_the_notebook_do_what_they_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (DOCS / "cookbook/notebook.md").read_text(encoding="utf-8")
    block = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)[0]
    assert len([line for line in block.splitlines() if line]) <= 5
    # This noise has N = 0.005 deg/s/√Hz, which is 0.3 deg/√h.
    noise = np.random.default_rng(1).normal(0.0, 0.05, (3000, 3))
    np.savez(tmp_path / "rest.npz", gyro_dps=noise, fs_hz=100.0)
    monkeypatch.chdir(tmp_path)
    exec(block, {})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" ")[0] for line in lines] == ["gyro_x;", "gyro_y;", "gyro_z;"]
    for line in lines:
        name, N, B, K = line.split("; ")
        value, low, high = map(float, re.findall(r"[\d.]+", N))
        assert low < 0.3 < high
        assert value == pytest.approx(0.3, rel=0.05)
        assert (N.split(" ")[1], B.endswith(" deg/h"), K.endswith(" deg/h/√h")) == ("deg/√h", True, True)
        assert (tmp_path / f"{name}.svg").read_text(encoding="utf-8").count("polyline") > 3


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
    np.testing.assert_allclose(recording.gyro / recording.lsb_per_dps, np.degrees(counts * 0.001065))


@pytest.mark.slow
def test_the_example_of_a_navigation_filter_gives_what_the_page_says(tmp_path: Path) -> None:
    section = (
        (DOCS / "guide/verdict.md")
        .read_text(encoding="utf-8")
        .split("## What a navigation filter needs\n")[1]
        .split("\n## ")[0]
    )
    model, table = (re.search(rf"```{kind}\n(.*?)```", section, re.DOTALL) for kind in ("json", "text"))
    (tmp_path / "sensor.json").write_text(model[1])
    files = {name: str(tmp_path / name) for name in ("sensor.json", "rest.npz", "navigation.json")}
    shown = ""
    for line in re.findall(r"^    fltea (.*)$", section, re.MULTILINE):
        done = fltea(*(files.get(word, word) for word in shlex.split(line)))
        assert (done.returncode, done.stderr) == (0, "")
        shown = done.stdout
    rows = [line.split() for line in shown.splitlines()]
    for line in table[1].splitlines():
        assert line.split() in rows
    assert (tmp_path / "navigation.json").exists()


@pytest.mark.parametrize("text", [*(page.relative_to(ROOT).as_posix() for page in PAGES), *INCLUDED])
def test_lists_are_written_as_both_github_and_the_site_read_them(text: str) -> None:
    """Python's Markdown needs an empty line before a list, and four spaces for each level."""
    lines = FENCED.sub("", (ROOT / text).read_text(encoding="utf-8")).split("\n")
    for before, line in itertools.pairwise(lines):
        if re.match(r"([-*]|\d+\.) ", line):
            assert not before or re.match(r"([-*]|\d+\.) | {2,}", before), line
        assert not re.match(r" {1,3}([-*]|\d+\.) ", line), line


def test_every_command_and_option_is_in_the_reference() -> None:
    text = site_hooks.commands()
    for name, flags in FLAGS.items():
        section = text.split(f"\n## `fltea {name}`\n")[1].split("\n## ")[0]
        options = " ".join(re.findall(r"^\* `([^`]*)`", section, re.MULTILINE))
        assert flags <= set(re.split(r"[ ,/]+", options)), name
    assert "..." not in text.partition("\n## ")[0].replace("[ARGS]...", "")


def test_every_field_of_every_record_is_in_the_reference() -> None:
    found = {line.split("`")[1] for line in site_records.records().splitlines() if line.startswith("| `")}
    assert {"class", "axes.<axis>.alpha", "link.bad_frames.<reason>"} <= found
    assert {"axes.<axis>.tracker.heading_std.<t>", "outputs.<output>.dropped"} <= found
    assert {"board.overruns", "device_estimator.interventions.<axis>.<reason>"} <= found


def test_the_schema_of_records_describes_them() -> None:
    schema = msgspec.json.decode(site_records.schema())
    parts = [part["properties"] for part in schema["$defs"].values()]
    assert all("description" in field for part in parts for name, field in part.items() if name != "class")
    assert schema["$defs"]["Epoch"]["properties"]["class"] == {"enum": ["epoch"]}
    assert set(schema["$defs"]["Epoch"]["required"]) <= set(Epoch.__struct_fields__) | {"class"}
    kinds = {kind.__name__ for kind in AnyRecord.__args__}
    assert kinds <= set(schema["$defs"])


def test_a_cell_stays_one() -> None:
    assert site_settings.cell("a | b\n<c>") == "a \\| b &lt;c>"
    assert "|" not in site_settings.code("a|b")
