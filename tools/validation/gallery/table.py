"""What the gallery says, as rows for people and for programs (pure)."""

from collections.abc import Sequence

import msgspec

from tools.validation.gallery.noises import NOISES
from tools.validation.gallery.run import MARGIN, Gallery, Seen

SIGNS = {"right": "", "cannot be told": "?", "wrong": "✗"}
"""Beside a verdict."""
HEADINGS = ("noise", "record", "verdict", "right would be")


def to_json(gallery: Gallery) -> bytes:
    """Indented JSON, with a line feed at its end."""
    return msgspec.json.format(msgspec.json.encode(gallery), indent=1) + b"\n"


def summary(gallery: Gallery) -> list[str]:
    """The figures that count, a sentence each."""
    total, without = len(gallery.seen), gallery.without_order
    claims = sum(one.kind == "fractional" for one in gallery.seen)
    true_claims = sum(one.kind == "fractional" for one in gallery.seen if one.has_order)
    told = sum(one.kind == "fractional" for one in gallery.tellable)
    right, untold, wrong = (gallery.count(o) for o in ("right", "cannot be told", "wrong"))
    return [
        f"Of {total} records {right} verdicts are right ({_share(right, total)}), {untold} say less since "
        f"the record cannot tell ({_share(untold, total)}), and {wrong} are wrong ({_share(wrong, total)}).",
        f"Of {len(without)} records of noises without an order {gallery.false_orders} are called "
        f'"fractional" ({_share(gallery.false_orders, len(without))}).',
        f"Of {len(gallery.seen) - len(without)} records of noises with an order {true_claims} are called "
        f'"fractional", {told} of the {len(gallery.tellable)} whose length tells it from relaxations.',
        f'Of {claims} claims of "fractional" {gallery.close_claims} have a sum of relaxations within '
        f"{MARGIN:g} in 2 log L.",
    ]


def wrong_rows(gallery: Gallery) -> list[tuple[str, ...]]:
    """Of each noise, rate and length whose verdicts are wrong: how many are, and what they say."""
    rows: list[tuple[str, ...]] = []
    for found in _grouped(gallery).values():
        bad = [one for one in found if one.outcome == "wrong"]
        if bad:
            name, record = found[0].cell.noise, _record(found[0])
            rows.append((name, record, f"{_kinds(bad)} of {len(found)}", ", ".join(found[0].right)))
    return rows


def markdown(gallery: Gallery) -> str:
    """The whole table: a row a noise, a column a rate and length, verdicts in its cells."""
    groups = _grouped(gallery)
    columns = list(dict.fromkeys((rate, length) for _, rate, length in groups))
    names = list(dict.fromkeys(name for name, _, _ in groups))
    lines = [
        "| noise | truth | "
        + " | ".join(f"{rate:g} Hz, {duration(length)}" for rate, length in columns)
        + " |",
        "|---" * (len(columns) + 2) + "|",
    ]
    for name in names:
        row = [_cell(groups.get((name, *column), [])) for column in columns]
        lines.append(f"| {name} | {NOISES[name].words} | " + " | ".join(row) + " |")
    return "\n".join(lines) + "\n"


def reasons(gallery: Gallery) -> list[tuple[str, ...]]:
    """Of each noise, rate and length that cannot be told: what was said, and why that is accepted."""
    rows: list[tuple[str, ...]] = []
    for found in _grouped(gallery).values():
        untold = [one for one in found if one.outcome == "cannot be told"]
        if untold:
            why = "; ".join(dict.fromkeys(one.reason for one in untold))
            rows.append((found[0].cell.noise, _record(found[0]), f"{_kinds(untold)} of {len(found)}", why))
    return rows


def duration(seconds: float) -> str:
    """In the unit that one would choose."""
    for limit, size, unit in ((120, 1, "s"), (7200, 60, "min")):
        if seconds < limit:
            return f"{seconds / size:g} {unit}"
    return f"{seconds / 3600:g} h"


def _grouped(gallery: Gallery) -> dict[tuple[str, float, float], list[Seen]]:
    groups: dict[tuple[str, float, float], list[Seen]] = {}
    for one in gallery.seen:
        groups.setdefault((one.cell.noise, one.cell.rate_hz, one.cell.duration_s), []).append(one)
    return groups


def _cell(found: Sequence[Seen]) -> str:
    said: dict[str, int] = {}
    for one in found:
        text = f"{one.kind}{SIGNS[one.outcome]}"
        said[text] = said.get(text, 0) + 1
    if len(found) == 1:
        return next(iter(said))
    return ", ".join(f"{text} {count}" for text, count in sorted(said.items(), key=lambda item: -item[1]))


def _kinds(found: Sequence[Seen]) -> str:
    kinds = dict.fromkeys(one.kind for one in found)
    return ", ".join(f"{kind} {sum(one.kind == kind for one in found)}" for kind in kinds)


def _record(one: Seen) -> str:
    return f"{one.cell.rate_hz:g} Hz, {duration(one.cell.duration_s)}"


def _share(count: int, total: int) -> str:
    return f"{count / total:.1%}" if total else "none"
