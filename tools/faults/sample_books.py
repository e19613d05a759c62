"""The boards' books against the workers': what became of every sample."""

import time
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain

from tools.fault_script.program import Program, wait_until
from tools.faults.boards import Boards
from tools.faults.row import Row
from tools.frames_load import RATE_HZ

PART = "ingest"

Sample = tuple[str, int]
"""A board's name, and the number of one of its samples."""


def samples(workers: Iterable[Program]) -> set[Sample]:
    """What was delivered, by any of them."""
    return {(r["device"], r["seq"]) for worker in workers for r in worker.of("sample")}


def heard(worker: Program, since: int = 0) -> set[str]:
    """Whose samples, of these numbers or later, a worker has walked."""
    return {record["device"] for record in worker.of("sample") if record["seq"] >= since}


def until_all_again(boards: Boards, workers: Iterable[Program]) -> None:
    """Wait until samples of all boards arrive that are not published yet."""
    since, programs = boards.samples, list(workers)
    wait_until(
        lambda: set().union(*(heard(one, since) for one in programs)) == set(boards.names),
        "samples of all sensors",
    )


def row(name: str, boards: Boards, workers: Sequence[Program], more: str, wrong: Sequence[str] = ()) -> Row:
    """Let all that was published arrive, end the workers, and account for it."""
    time.sleep(1.0)
    boards.stop()
    living = [worker for worker in workers if worker.code is None]
    last = {(board, boards.samples - 1) for board in boards.names}
    wait_until(lambda: last <= samples(living), "the last samples")
    with ThreadPoolExecutor() as pool:  # at the same time: else the last one takes what the others give back
        list(pool.map(lambda worker: worker.end(), living))
    found = [*wrong, *(worker.stderr[-500:] for worker in living if worker.code != 0)]
    return account(name, boards.names, boards.samples, workers, more, found)


def account(
    name: str,
    boards: Sequence[str],
    published: int,
    workers: Sequence[Program],
    more: str = "",
    wrong: Sequence[str] = (),
) -> Row:
    """What became of the samples from 0 to `published` of each board, as the workers' records have it."""
    due = {(board, at) for board in boards for at in range(published)}
    delivered, counted = samples(workers), _lost(workers)
    lost = counted - delivered
    first = {(board, at) for board in boards for at in range(RATE_HZ)} - delivered - lost
    checks = {
        "nobody sent": (delivered | counted) - due,
        "counted as lost, but delivered": counted & delivered,
        "nobody knows of": due - delivered - lost - first,
    }
    found = [*wrong, *(f"{what}: {_shown(which)}" for what, which in checks.items() if which)]
    where = {
        "delivered": len(delivered),
        "counted as lost": len(lost),
        "before a sensor's second message": len(first),
    }
    told = list(dict.fromkeys(chain(*(worker.errors() for worker in workers))))
    twice = sum(len(worker.of("sample")) for worker in workers) - len(delivered)
    return Row(PART, name, told, "samples", len(due), where, f"{more}; {twice} delivered twice", found)


def _lost(workers: Iterable[Program]) -> set[Sample]:
    return {
        (r["device"], at)
        for worker in workers
        for r in worker.of("gap")
        for at in range(r["seq"], r["seq"] + r["missing"])
    }


def _shown(found: set[Sample]) -> str:
    """How many of each board, and from which number on."""
    counts = Counter(name for name, _ in found)
    return ", ".join(
        f"{count} of {name} from {min(at for one, at in found if one == name)}"
        for name, count in sorted(counts.items())
    )
