"""Compares the time of `fltea identify` with that of the Allan deviation alone, and with another commit.

make bench ARGS='--identify --against HEAD~3 --long'
"""

from typing import Any

from tools.bench import bench_chain
from tools.bench.bench_chain import spread
from tools.bench.chain_rows import IDENTIFY
from tools.bench.programs import PRESENT


def measure(*, long: bool = False, against: str | None = None, rounds: int | None = None) -> dict[str, Any]:
    """Measure records of ten minutes, an hour and, with `long`, a day, as `bench_chain.measure` does."""
    kinds = [kind for kind in IDENTIFY if kind != "day" or long]
    rows = ",".join(row for kind in kinds for row in IDENTIFY[kind])
    return bench_chain.measure(long=long, rows=rows, against=against, rounds=rounds)


def text(found: dict[str, Any]) -> str:
    """Return the tables, and the ratio of the time of `fltea identify` to that of the Allan deviation.

    Both programs process the same axes.
    """
    lines = [bench_chain.text(found)]
    for kind, (own, *others) in IDENTIFY.items():
        peer = next(name for name in others if name.endswith("oadev"))
        if own not in found["runs"]:
            continue
        said = []
        for key, what in (("wall_s", "wall-clock"), ("cpu_s", "processor")):
            its = spread(found["runs"][own].get(PRESENT.name, []), key)
            its_peer = spread(found["runs"][peer].get(PRESENT.name, []), key)
            if its is not None and its_peer is not None:
                said.append(f"{its[0] / its_peer[0]:.2f} times the {what} time")
        lines.append(f"{kind}: identify takes {' and '.join(said)} of allantools for the Allan deviation.")
    return "\n".join(lines)
