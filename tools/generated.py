"""Writes the committed files that a program generates, or checks that they are up to date.

  python -m tools.generated                    all files; `make gen`
  python -m tools.generated gen_protocol       the files of the named writers
  python -m tools.generated --check            writes nothing; names the files that differ, exit code 1

A writer is a module with the constant SOURCE and the function `outputs`. SOURCE names the source of the
writer's files. `outputs` gets the repository's root, and returns the path and the text of each file. The id
of the firmware's sources is written last, because it depends on other generated files.
"""

import argparse
import sys
import textwrap
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

WRITERS = (
    *("gen_settings", "gen_formats", "gen_protocol", "gen_registers", "make_vectors"),
    *("gen_memory_constants", "gen_fixed_nodes", "gen_octave_tables", "make_golden", "build_id"),
)

WIDTH = 110

TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).with_name("templates")),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


def camel(name: str) -> str:
    """Turn SAMPLE into Sample and sampling_mode into SamplingMode."""
    return "".join(word.capitalize() for word in name.split("_"))


def wrapped(text: str, indent: str) -> str:
    """Wrap a text into lines that begin with `indent`, which may be a comment sign."""
    return textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent)


def docstring(text: str) -> str:
    """Return a text as the docstring of a field in Python."""
    return wrapped(f'"""{text[0].upper()}{text[1:].rstrip(".")}."""', "    ")


def cell(text: str) -> str:
    """Return a text escaped for a table in Markdown."""
    return text.replace("|", "\\|")


def rows(values: Sequence[object], in_one: int, indent: int = 4) -> str:
    """Return the values as source text: lines of `in_one` values each, with a comma after each value."""
    lines = (values[i : i + in_one] for i in range(0, len(values), in_one))
    return "\n".join(" " * indent + " ".join(f"{value}," for value in line) for line in lines)


TEMPLATES.filters |= {"hex": "0x{:08X}".format, "camel": camel, "wrapped": wrapped, "rows": rows}
TEMPLATES.filters |= {"docstring": docstring, "cell": cell}


def rendered(template: str, **values: Any) -> str:
    """Render a template of `tools/templates` with these values."""
    return TEMPLATES.get_template(f"{template}.j2").render(values)


def update(root: Path, wanted: Mapping[str, str], *, check: bool, source: str) -> int:
    """Write the files whose contents differ from `wanted`.

    If `check` is True, only print a message with the name of each such file.

    `wanted`: texts by path below `root`. `source`: name of the source of the texts, for messages. Returns the
    exit code: 1 if `check` found a difference. An unchanged file keeps its modification time, so that nothing
    is rebuilt.
    """
    status = 0
    for name, text in wanted.items():
        path = root / name
        if path.exists() and path.read_text(encoding="utf-8") == text:
            continue
        if check:
            print(f"{name} differs from {source}: run `make gen`", file=sys.stderr)
            status = 1
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
            print(f"wrote {name}")
    return status


def main() -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "writers", nargs="*", metavar="WRITER", help=f"default: all; any of {', '.join(WRITERS)}"
    )
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if a file differs")
    root = Path(__file__).resolve().parent.parent
    parser.add_argument("--root", type=Path, default=root, help="repository")
    given, status = parser.parse_args(), 0
    if unknown := {*given.writers} - {*WRITERS}:
        parser.error(f"there is no writer {', '.join(unknown)}")
    for writer in map(import_module, (f"tools.{name}" for name in given.writers or WRITERS)):
        try:
            wanted = writer.outputs(given.root)
            status |= update(given.root, wanted, check=given.check, source=writer.SOURCE)
        except ValueError as error:
            print(f"{writer.SOURCE}: {error}", file=sys.stderr)
            status = 1
    return status


if __name__ == "__main__":
    sys.exit(main())
