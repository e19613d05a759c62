"""Reports a run as a JSON object, or as lines for people (tools/due_emulator/README.md lists the fields)."""

from collections.abc import Sequence
from typing import Any

from tools.due_emulator.board import Board
from tools.due_emulator.host_view import HostView, plain, seconds
from tools.due_emulator.image import Image


def make_report(
    board: Board,
    host: HostView,
    image: Image,
    *,
    wall_s: float | None,
    error: str | None,
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the report of a run as a dictionary.

    `wall_s`: real duration of the run; None if it ran in real time. `error`: why the run ended early; None if
    it did not.
    """
    host.stop()
    machine, bridge = board.machine, board.bridge
    touched = board.memory.ram_touched_bytes()
    elapsed_ps = machine.now_ps or 1
    return {
        "virtual_s": seconds(machine.now_ps),
        "wall_s": None if wall_s is None else round(wall_s, 3),
        "speed": None if wall_s is None else round(machine.now_ps / 1e12 / wall_s, 2),
        "error": error,
        "faults": [*board.events, *host.told.fault_texts],
        "notes": list(notes),
        "image": str(image.path),
        "build_id": image.build_id,
        "flash_bytes": image.flash_bytes,
        "ram_bytes": image.ram_bytes if image.ram_bytes is not None else touched,
        "ram_touched_bytes": touched,
        **_heard(host),
        "boots": host.told.boot_count,
        "hellos": host.told.hello_count,
        "resets": board.resets,
        **_messages(host),
        "bytes_lost_by_fault": bridge.lost_by_fault,
        "bytes_lost_in_bridge": bridge.lost_in_bridge,
        "bytes_garbled": bridge.garbled,
        "bus_load": round(board.twi.load_ps / elapsed_ps, 6),
        "i2c_transfers": board.twi.transfers,
        "recovery_clocks": board.lines.recovery_clocks,
        "uart_load": round(board.uart.busy_ps / elapsed_ps, 6),
        "sleeping": round(machine.idle_ps / elapsed_ps, 6),
        "instructions": board.cpu.instructions,
    }


def _heard(host: HostView) -> dict[str, Any]:
    """Return figures of the samples: how many were due, delivered and lost, their rate and their flags."""
    counts, due, steps = host.counts, host.due, host.steps
    heard = sum(last - first + 1 for first, last in (boot.heard for boot in host.boots if boot.heard))
    return {
        "samples": counts.delivered,
        "gaps": counts.gaps,
        "lost": counts.lost,
        "due": due,
        "unheard": None if due is None else due - heard,
        "duplicates": counts.duplicates,
        "before_hello": counts.before_hello,
        "rate_hz": None if steps.rate_hz is None else round(steps.rate_hz, 6),
        "step_us": {"min": steps.min_us, "max": steps.max_us},
        "flags": host.flags,
    }


def _messages(host: HostView) -> dict[str, Any]:
    """Return what the host received besides samples: other messages, and its counts of all bytes."""
    counts, told = host.reader.counts, host.told
    return {
        "hello": plain(told.hello),
        "refused": host.refused,
        "status": plain(told.statuses[-1]) if told.statuses else None,
        "statuses": [plain(status) for status in told.statuses],
        "bytes": host.bytes_in,
        "frames": counts["frames"],
        "bad_frames": {reason: n for reason, n in sorted(counts.items()) if reason != "frames"},
    }


def describe(report: dict[str, Any]) -> str:
    """Return the report as lines of text for people."""
    rate, step = report["rate_hz"], report["step_us"]
    lines = [
        f"{report['image']}, build {report['build_id']}: {report['flash_bytes']} bytes of flash, "
        f"{report['ram_bytes']} of RAM ({report['ram_touched_bytes']} written)",
        f"{report['virtual_s']:g} s of virtual time"
        + (
            ""
            if report["speed"] is None
            else f" in {report['wall_s']:g} s: {report['speed']:g} times real time"
        ),
        f"{report['samples']} samples, {report['gaps']} gaps, {report['lost']} lost"
        + ("" if report["due"] is None else f", {report['unheard']} unheard of {report['due']} due")
        + ("" if rate is None else f"; {rate:.4f} Hz, steps of {step['min']} to {step['max']} us"),
        f"{report['frames']} frames, bad: {report['bad_frames'] or 'none'}; I2C busy "
        f"{report['bus_load']:.1%}, UART {report['uart_load']:.1%}, processor asleep "
        f"{report['sleeping']:.1%}",
    ]
    if report["status"]:
        lines.append("status: " + ", ".join(f"{name} {value}" for name, value in report["status"].items()))
    lines += [f"fault: {fault}" for fault in report["faults"]]
    lines += [f"note: {note}" for note in report["notes"]]
    if report["refused"]:
        lines.append(f"refused: {report['refused']}")
    if report["error"]:
        lines.append(f"ENDED EARLY: {report['error']}")
    return "\n".join(lines)
