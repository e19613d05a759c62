"""The board's books against the daemon's: what became of every sampling instant."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from tools.fault_script.board import LSB_PER_DPS, Board, Instants


class Account(NamedTuple):
    """What became of the sampling instants that were due.

    due = delivered + lost + unheard + uncounted. unheard: before the first sample of a boot that a program
    used, or after the last: no other number tells of them. uncounted: between those two, but neither
    delivered nor told as lost. wrong: what else does not add up.
    """

    due: int
    delivered: int
    lost: int
    unheard: int
    uncounted: int
    wrong: list[str]


class _Books:
    """What one program said of the samples."""

    def __init__(self, board: Board, records: Sequence[dict[str, Any]], wrong: list[str]) -> None:
        self.delivered: Instants = set()
        self.lost: Instants = set()
        self._boots = {boot.boot_id: i for i, boot in enumerate(board.boots)}
        self._board = board
        self._boot_of_epoch: dict[int, int] = {}
        for record in records:
            match record["class"]:
                case "epoch":
                    self._boot_of_epoch[record["epoch"]] = self._boots[record["boot_id"]]
                case "sample":
                    self._on_sample(record, wrong)
                case "gap":
                    found = [self._instant(record, k) for k in range(record["missing"])]
                    if not self.lost.isdisjoint(found):
                        wrong.append(f"lost twice: {found}")
                    self.lost.update(found)

    def _instant(self, record: dict[str, Any], k: int = 0) -> tuple[int, int]:
        i = self._boot_of_epoch[record["epoch"]]
        return i, (record["seq"] + k - self._board.boots[i].sequence) % (1 << 16)

    def _on_sample(self, record: dict[str, Any], wrong: list[str]) -> None:
        instant = i, k = self._instant(record)
        counts = tuple(round(rate * LSB_PER_DPS) for rate in record["gyro_dps"])
        if instant in self.delivered:
            wrong.append(f"delivered twice: {instant}")
        if k >= self._board.boots[i].due or counts != self._board.boots[i].counts[k]:
            wrong.append(f"not what was sent: {instant} {counts}")
        self.delivered.add(instant)

    def span(self, boot: int) -> range:
        """Instants of a boot from the first that was used to the last."""
        found = [k for i, k in self.delivered if i == boot]
        return range(min(found), max(found) + 1) if found else range(0)


def account(
    board: Board, programs: Sequence[Sequence[dict[str, Any]]], *, line_is_known: bool = True
) -> Account:
    """Compare what the board did with the records of the programs that listened, one after the other.

    line_is_known: false if somebody else took bytes from the line.
    """
    wrong: list[str] = []
    delivered: Instants = set()
    lost: Instants = set()
    spanned: Instants = set()
    arrived = board.arrived()
    uncounted = 0
    for records in programs:
        books = _Books(board, records, wrong)
        spans = {(i, k) for i in range(len(board.boots)) for k in books.span(i)}
        told = books.delivered | books.lost
        uncounted += len(spans - told)
        if books.delivered & books.lost:
            wrong.append(f"delivered and lost: {sorted(books.delivered & books.lost)}")
        if not books.lost <= spans:
            wrong.append(f"lost, but nothing after it: {sorted(books.lost - spans)}")
        if not books.delivered <= arrived:
            wrong.append(f"delivered, but not whole on the line: {sorted(books.delivered - arrived)}")
        if line_is_known and (missed := (arrived & spans) - books.delivered):
            wrong.append(f"whole on the line, but not delivered: {sorted(missed)}")
        if delivered & books.delivered:
            wrong.append("two programs used the same sample")
        delivered |= books.delivered
        lost |= books.lost
        spanned |= spans
    due = sum(boot.due for boot in board.boots)
    return Account(due, len(delivered), len(lost), due - len(spanned), uncounted, wrong)


def check_totals(records: Sequence[dict[str, Any]]) -> list[str]:
    """What in a program's last `stats` is not the sum of its records."""
    stats = [record for record in records if record["class"] == "stats"][-1]["samples"]
    gaps = [record["missing"] for record in records if record["class"] == "gap"]
    samples = sum(record["class"] == "sample" for record in records)
    expected = {"delivered": samples, "lost": sum(gaps), "gaps": len(gaps), "duplicates": 0}
    return [
        f"stats.samples.{name} is {stats[name]}, not {value}"
        for name, value in expected.items()
        if stats[name] != value
    ]
