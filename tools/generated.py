"""Committed files that a program writes: brought up to date, or compared."""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path


def arguments(description: str) -> argparse.Namespace:
    """Return `check` and `root`, as the command line of a writer gives them."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if a file differs")
    parser.add_argument(
        "--root", type=Path, default=Path(__file__).resolve().parent.parent, help="repository"
    )
    return parser.parse_args()


def update(root: Path, wanted: Mapping[str, str], *, check: bool, source: str) -> int:
    """Write the files that differ from what belongs in them; with `check` name them instead.

    wanted: path below `root` to contents. source: what the contents come from. Returns the exit code: 1 if
    `check` found a difference. A file that is right already keeps its time stamp, so that nothing is rebuilt
    for it.
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
