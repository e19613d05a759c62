"""Compares the outputs of two machines for one recording.

Texts must be equal, and figures equal within a tolerance.

The filters' estimates are bitwise equal on every machine, because the compiler does not merge multiplications
with additions, and the logarithm is fltea's own. The result of a fit, which is a maximisation, depends on the
last bits of numpy and libm, which differ between processors.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

RELATIVE, ABSOLUTE = 1e-5, 1e-8


def differences(a: Any, b: Any, exactly: bool, where: str = "") -> Iterator[str]:
    """Yield each difference between the JSON values `a` and `b`, with its path in the records."""
    if isinstance(a, dict) and isinstance(b, dict) and a.keys() == b.keys():
        for name in a:
            yield from differences(a[name], b[name], exactly, f"{where}.{name}")
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for index, (one, other) in enumerate(zip(a, b, strict=True)):
            yield from differences(one, other, exactly, f"{where}[{index}]")
    elif isinstance(a, float) and isinstance(b, float) and not exactly:
        if not math.isclose(a, b, rel_tol=RELATIVE, abs_tol=ABSOLUTE):
            yield f"{where}: {a!r}, {b!r}"
    elif a != b:
        yield f"{where}: {a!r}, {b!r}"


def read(path: Path) -> list[Any]:
    """Return the JSON values in the lines of a file."""
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()]


def main() -> int:
    """Print the differences; return 1 if there are any."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs=2, type=Path)
    parser.add_argument("--exactly", action="store_true", help="figures are the same bit by bit")
    asked = parser.parse_args()
    ours, theirs = (read(path) for path in asked.files)
    found = list(differences(ours, theirs, asked.exactly))
    for line in found[:20]:
        print(line, file=sys.stderr)
    how = "bit by bit" if asked.exactly else f"to {RELATIVE:g}"
    print(
        f"{asked.files[0].name}, {asked.files[1].name}: {len(ours)} records, "
        f"{'the same ' + how if not found else f'{len(found)} differences'}"
    )
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
