"""Tests of man pages and shell completion.

Both are generated from the definitions of the command line. They are complete, and the programs that read
them accept them.
"""

import functools
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer.main
from fltea.cli.app import app

from tests.rig.host_support import PATIENCE_S
from tests.rig.toolchain import missing
from tools import man_pages

GROUP = typer.main.get_command(app)
COMMANDS = {"fltea": GROUP} | {f"fltea-{name}": one for name, one in GROUP.commands.items()}
PAGES = man_pages.pages()
WIDE = 10_000


@functools.cache
def seen(name: str) -> str:
    """Return a page as `man` shows it, in lines so long that no word is divided.

    Check that `man` gives no warnings.
    """
    groff = shutil.which("groff") or missing("groff is not installed")
    done = subprocess.run(
        [groff, "-man", "-Kutf8", "-Tutf8", "-ww", "-P-c", "-P-b", "-P-u", f"-rLL={WIDE}n"],
        input=PAGES[name],
        capture_output=True,
        encoding="utf-8",
        timeout=PATIENCE_S,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.replace("‐", "-").replace("−", "-")  # characters that groff writes in place of "-"


def test_every_command_has_a_page() -> None:
    assert set(PAGES) == {f"{name}.1" for name in COMMANDS}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_page_lists_every_option_with_its_text(name: str) -> None:
    page = seen(f"{name}.1")
    for parameter in COMMANDS[name].params:
        if parameter.hidden:
            continue
        assert parameter.help, f"{name}: {parameter.name} has no help"
        if parameter.param_type_name == "option":
            for flag in (*parameter.opts, *parameter.secondary_opts):
                assert re.search(rf"^ +(\S+, )*{re.escape(flag)}\b", page, re.MULTILINE), flag
        words = " ".join(parameter.help.replace("`", "").replace("host/docs", man_pages.DOCUMENTS).split())
        assert words.rstrip(".") in " ".join(page.split()), parameter.name
    assert "EXIT STATUS" in page


def test_a_page_lists_every_command_and_every_example() -> None:
    for name, command in GROUP.commands.items():
        assert f"fltea-{name}(1)" in seen("fltea.1")
        examples = command.help.partition(man_pages.EXAMPLES)[2].split("\n")
        assert any(examples)
        assert all(example.strip() in seen(f"fltea-{name}.1") for example in examples)


def test_pages_name_documents_that_the_package_holds() -> None:
    """The Debian package made by deb.sh contains all of host/docs."""
    named = {
        path
        for text in PAGES.values()
        for path in re.findall(rf"{man_pages.DOCUMENTS}/([\w/]+\.md)", text.replace("\\-", "-"))
    }
    assert len(named) > 3
    assert [path for path in sorted(named) if not (man_pages.ROOT / "host/docs" / path).is_file()] == []
    assert not any("host/docs" in text for text in PAGES.values())


def test_text_is_no_request_of_roff() -> None:
    assert man_pages.roff(".TH\n'x\na\\fB`b`-") == "\\&.TH\n\\&'x\na\\efB\\fBb\\fP\\-"


# --- completion ---


def environment(**more: str) -> dict[str, str]:
    folder = Path(sys.executable).parent
    if not (folder / "fltea").exists():
        pytest.skip("the command fltea is not installed")
    return {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}", **more}


def asked(*command: str, **more: str) -> str:
    done = subprocess.run(
        command, env=environment(**more), capture_output=True, encoding="utf-8", timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_bash_completes_commands_and_options(tmp_path: Path) -> None:
    script = tmp_path / "fltea"
    script.write_text(man_pages.completions()["bash/fltea"])
    ask = "COMP_WORDS=({}); COMP_CWORD={}; _fltea_completion fltea; echo ${{COMPREPLY[@]}}"
    lines = (
        f"source {shlex.quote(str(script))}\n{ask.format('fltea id', 1)}\n{ask.format('fltea run --form', 2)}"
    )
    assert asked("bash", "--norc", "-c", lines) == "identify\n--format\n"


def test_zsh_and_fish_get_their_answers() -> None:
    zsh = asked("fltea", _FLTEA_COMPLETE="complete_zsh", _TYPER_COMPLETE_ARGS="fltea run --form")
    assert '"--format"' in zsh
    fish = asked(
        "fltea",
        _FLTEA_COMPLETE="complete_fish",
        _TYPER_COMPLETE_FISH_ACTION="get-args",
        _TYPER_COMPLETE_ARGS="fltea id",
    )
    assert fish.startswith("identify")


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_a_shell_that_is_there_reads_its_script(shell: str, tmp_path: Path) -> None:
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"{shell} is not installed")
    script = tmp_path / "script"
    script.write_text(man_pages.completions()[man_pages.COMPLETIONS[shell]])
    asked(program, "-n", str(script))
