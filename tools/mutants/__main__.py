"""Puts single bugs into the firmware, one at a time, and asks who notices (`make mutants`).

Judges: the emulated Due (the strictness of its parts, and tools.mutants.trial), the C++ tests of the core and
of its spectrum, and the Arduino sketch on its stub. The first that notices a bug is enough; --everyone asks
all. That the committed image has other bytes does not count. Everything happens in private copies.

Exit codes: 0; 1 more than 2 mutants survive, a mutant does not build, or the present sources fail already.
"""

import argparse
import json
import shutil
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from tools.mutants.mutation import Mutant, read_mutants
from tools.mutants.workshop import Invalid, Verdict, copy_parts, forget_build, judge

MOST_SURVIVORS = 2

EVERYWHERE = ("core/engine/", "arduino/")
"""Files for which all judges together are asked."""


class Result(NamedTuple):
    """invalid: why the mutant says nothing; None if it does."""

    mutant: Mutant
    verdicts: list[Verdict]
    invalid: str | None

    @property
    def survives(self) -> bool:
        """Whether nobody noticed."""
        return self.invalid is None and not any(verdict.noticed for verdict in self.verdicts)

    def describe(self) -> str:
        """One line, or as many as judges noticed."""
        head = f"{self.mutant.name} ({self.mutant.file}): {self.mutant.breaks}"
        if self.invalid is not None:
            return f"INVALID  {head}\n{self.invalid}"
        if self.survives:
            return f"SURVIVES {head}"
        told = [f"\n         {v.judge}: {v.noticed}" for v in self.verdicts if v.noticed]
        return f"noticed  {head}{''.join(told)}"

    def plain(self) -> dict[str, object]:
        """As JSON can hold it."""
        return {
            "name": self.mutant.name,
            "file": self.mutant.file,
            "breaks": self.mutant.breaks,
            "survives": self.survives,
            "invalid": self.invalid,
            "noticed_by": {v.judge: v.noticed for v in self.verdicts if v.noticed},
            "judges": [v.judge for v in self.verdicts],
        }


def try_mutant(mutant: Mutant, base: Path, *, everyone: bool = False) -> Result:
    """Judge one bug in a copy of `base`, which keeps what is built there already."""
    with tempfile.TemporaryDirectory(dir=base.parent) as folder:
        root = Path(folder) / "fltea"
        shutil.copytree(base, root)
        try:
            mutant.apply(root)
            return Result(mutant, judge(root, mutant.file, everyone=everyone), None)
        except (Invalid, ValueError) as error:
            return Result(mutant, [], str(error))


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.mutants",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--only", action="append", default=[], metavar="NAME", help="may be given again")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--everyone", action="store_true", help="ask all judges of each bug")
    parser.add_argument("--jobs", type=int, default=2, help="so many at a time")
    options = parser.parse_args()
    mutants = [m for m in read_mutants() if not options.only or m.name in options.only]
    if unknown := set(options.only) - {m.name for m in mutants}:
        parser.error(f"no such mutant: {', '.join(sorted(unknown))}")
    with tempfile.TemporaryDirectory(prefix="fltea-mutants-") as folder:
        base = Path(folder) / "base"
        copy_parts(base)
        try:
            present = [verdict for file in EVERYWHERE for verdict in judge(base, file, everyone=True)]
            failing = [verdict for verdict in present if verdict.noticed]
        except Invalid as error:
            print(f"the present sources do not build:\n{error}", file=sys.stderr)
            return 1
        for verdict in failing:
            print(f"the present sources fail already: {verdict.judge}: {verdict.noticed}", file=sys.stderr)
        if failing:
            return 1
        forget_build(base)
        results = []
        with ThreadPoolExecutor(options.jobs) as pool:
            for result in pool.map(lambda m: try_mutant(m, base, everyone=options.everyone), mutants):
                results.append(result)
                print(result.describe(), file=sys.stderr if options.json else sys.stdout, flush=True)
    survivors = [result.mutant.name for result in results if result.survives]
    invalid = [result.mutant.name for result in results if result.invalid is not None]
    if options.json:
        print(json.dumps([result.plain() for result in results], indent=2, ensure_ascii=False))
    else:
        print(
            f"{len(results)} mutants: {len(results) - len(survivors) - len(invalid)} noticed, "
            f"{len(survivors)} survive ({', '.join(survivors) or '-'}), "
            f"{len(invalid)} invalid ({', '.join(invalid) or '-'})"
        )
    return 1 if invalid or len(survivors) > MOST_SURVIVORS else 0


if __name__ == "__main__":
    sys.exit(main())
