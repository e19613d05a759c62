"""Puts single bugs into the firmware, or random ones into the host, and runs the tests (`make mutants`).

A bug that no test notices survives. `--host 40` tries 40 random changes of host/fltea, one at a time
(tools.mutants.host_changes). For each change it runs tests until one fails: first the test files that import
the changed module, then the other files of the same folder of tests, then tests/e2e. Tests that are marked as
slow do not run. Some changes have no effect that a test could notice, so read the list of survivors.

Without `--host` it tries the firmware's list. The tests are in groups, called judges: the tests of the
emulated Due, whose components are strict; the C++ tests of the core and of its spectrum; the Arduino sketch
on its stub. By default, a bug is judged until the first judge notices it. With --everyone, all judges run. A
bug does not count as noticed merely because the built image differs from the committed image.

The program works only on copies of the repository. The exit code is 1 in these cases: more than 2 mutants of
the firmware survive, more than a third of the host's mutants survive, a mutant does not build, or the tests
fail even without a bug. Otherwise it is 0.
"""

import argparse
import shutil
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from queue import Queue
from typing import NamedTuple

from tools.mutants.host_changes import Change, choose
from tools.mutants.host_trial import HostCopy
from tools.mutants.workshop import (
    REPOSITORY,
    Invalid,
    Mutant,
    Verdict,
    copy_parts,
    forget_build,
    judge,
    read_mutants,
)

MOST_SURVIVORS = 2
MOST_SURVIVORS_OF_HOST = 1 / 3

EVERYWHERE = ("core/engine/", "arduino/")
"""Two folders of firmware/. A bug in the first is judged by three of the judges (groups of tests), a bug in
the second by the remaining one. So both together need all judges.
"""


class Result(NamedTuple):
    """What each judge (a group of tests) says about a mutant.

    `invalid`: why the mutant cannot be judged, or None.
    """

    mutant: Mutant
    verdicts: list[Verdict]
    invalid: str | None

    @property
    def survives(self) -> bool:
        return self.invalid is None and not any(verdict.noticed for verdict in self.verdicts)

    def describe(self) -> str:
        """Return a line about the bug, and one for each judge (group of tests) that noticed it."""
        head = f"{self.mutant.name} ({self.mutant.file}): {self.mutant.breaks}"
        if self.invalid is not None:
            return f"INVALID  {head}\n{self.invalid}"
        if self.survives:
            return f"SURVIVES {head}"
        judges = [f"\n         {v.judge}: {v.noticed}" for v in self.verdicts if v.noticed]
        return f"noticed  {head}{''.join(judges)}"


def try_mutant(mutant: Mutant, base: Path, *, everyone: bool = False) -> Result:
    """Judge one bug in a copy of the folder `base`, a copy of the repository that may have built files."""
    with tempfile.TemporaryDirectory(dir=base.parent) as folder:
        root = Path(folder) / "fltea"
        shutil.copytree(base, root)
        try:
            mutant.apply(root)
            return Result(mutant, judge(root, mutant.file, everyone=everyone), None)
        except (Invalid, ValueError) as error:
            return Result(mutant, [], str(error))


def try_host(drawn: list[Change], jobs: int) -> int:
    """Judge random changes of the host, print which test noticed each, and return the exit code."""
    copies: Queue[HostCopy] = Queue()

    def judged(change: Change) -> str | None:
        copy = copies.get()
        try:
            return copy.noticed_by(change)
        except Invalid as error:
            return f"pytest itself fails: {str(error)[-500:]}"
        finally:
            copies.put(copy)

    with ExitStack() as stack:
        for _ in range(jobs):
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="fltea-mutants-"))
            copies.put(HostCopy(Path(folder)))
        survive = 0
        for change, test in zip(
            drawn, stack.enter_context(ThreadPoolExecutor(jobs)).map(judged, drawn), strict=True
        ):
            survive += test is None
            print(f"SURVIVES {change}" if test is None else f"noticed  {change}\n         {test}", flush=True)
    print(f"{len(drawn)} random changes: {len(drawn) - survive} noticed, {survive} survive")
    return 1 if survive > MOST_SURVIVORS_OF_HOST * len(drawn) else 0


def main() -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.mutants",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="try only this mutant; repeatable"
    )
    parser.add_argument("--everyone", action="store_true", help="run all judges on each bug")
    parser.add_argument("--jobs", type=int, default=2, help="number of mutants judged at the same time")
    host = parser.add_argument_group("mutants of the host instead of the firmware")
    host.add_argument("--host", type=int, metavar="COUNT", help="number of random changes to try")
    host.add_argument("--seed", type=int, default=1, help="seed of the random choice")
    host.add_argument("--below", default="", metavar="PATH", help="change only files below host/fltea/PATH")
    options = parser.parse_args()
    if options.host is not None:
        drawn = choose(REPOSITORY, options.host, options.seed, options.below)
        return try_host(drawn, options.jobs)
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
                print(result.describe(), flush=True)
    survivors = [result.mutant.name for result in results if result.survives]
    invalid = [result.mutant.name for result in results if result.invalid is not None]
    print(
        f"{len(results)} mutants: {len(results) - len(survivors) - len(invalid)} noticed, "
        f"{len(survivors)} survive ({', '.join(survivors) or '-'}), "
        f"{len(invalid)} invalid ({', '.join(invalid) or '-'})"
    )
    return 1 if invalid or len(survivors) > MOST_SURVIVORS else 0


if __name__ == "__main__":
    sys.exit(main())
