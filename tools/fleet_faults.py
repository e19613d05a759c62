"""Every fault of a fleet, one after the other, on a real broker: what was told, and where each fit went.

    python -m tools.fleet_faults             a table in Markdown
    python -m tools.fleet_faults disk        only those whose names hold a word

Needs mosquitto. Exit code 1: something does not add up.
"""

import argparse
import contextlib
import signal
import sqlite3
import struct
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from tools.fault_script.small_disk import SmallDisk
from tools.fault_script.stage import Skip
from tools.faults.fleet_stage import AXES, SENSORS, Outcome, Stage

DAY_NS = 86_400 * 10**9
SHORT_SPLIT_S, LONG_SPLIT_S = 2.0, 60.0
FIT_EVERY_S = 10.0
KEEPALIVE_PATIENCE_S = 60.0
"""A silent line is told after one to two keepalives of 15 s."""


def broker_killed(folder: Path) -> Outcome:
    """`kill -9`, and started again."""
    with contextlib.closing(Stage(folder)) as stage:
        stage.publish(2)
        stage.until(stage.is_up_to_date, "the fits")
        time.sleep(1.5)  # it saves once a second
        stage.broker.kill()
        stage.broker.wait()
        stage.until(lambda: not stage.summary()["connected"], "the loss")
        stage.start_broker()
        stage.until(lambda: stage.summary()["connected"], "the connection")
        stage.publish(2)
        stage.until(stage.is_up_to_date, "the fits")
        missed = stage.fits - stage.summary()["fits"]
        return stage.outcome(
            "broker killed (`kill -9`) and started again",
            f"{stage.newest()} of {SENSORS * AXES} axes have their newest fit",
            (missed > 0, f"{missed} fits missed"),
            (stage.summary()["outages"] != 1, "outages"),
        )


def split(folder: Path) -> Outcome:
    """Nothing gets through for a moment."""
    return _broker_stopped(folder, SHORT_SPLIT_S, lasts=False)


def long_split(folder: Path) -> Outcome:
    """Nothing gets through for a minute: longer than the fleet's connection lasts."""
    return _broker_stopped(folder, LONG_SPLIT_S, lasts=True)


def _broker_stopped(folder: Path, stopped_s: float, *, lasts: bool) -> Outcome:
    """The broker stands still, and so do all lines to it. lasts: long enough for the fleet to tell."""
    with contextlib.closing(Stage(folder)) as stage:
        stage.publish(1)
        stage.until(stage.is_up_to_date, "the fits")
        stage.broker.send_signal(signal.SIGSTOP)
        end_s = time.monotonic() + stopped_s
        while (left_s := end_s - time.monotonic()) > 0:
            stage.send()
            time.sleep(min(FIT_EVERY_S, left_s))
        told = stage.kinds()
        stage.broker.send_signal(signal.SIGCONT)
        stage.until_acknowledged()
        stage.until(lambda: stage.summary()["connected"], "the connection")
        return _after_split(
            stage,
            f"network split for {stopped_s:g} s",
            (("broker_lost" in told) != lasts, f"told meanwhile: {told}"),
            (stage.summary()["outages"] != int(lasts), "outages"),
        )


def cut_off(folder: Path) -> Outcome:
    """Of all that speak to the broker the fleet alone is cut off, until it has told so."""
    with contextlib.closing(Stage(folder, behind_line=True)) as stage:
        stage.publish(1)
        stage.until(stage.is_up_to_date, "the fits")
        stage.line.cut()
        stage.publish(1)
        stage.until(lambda: "broker_lost" in stage.kinds(), "word of it", KEEPALIVE_PATIENCE_S)
        stage.publish(2)
        stage.line.heal()
        stage.until(lambda: stage.summary()["connected"], "the connection")
        return _after_split(
            stage,
            "the fleet cut off from the broker until it tells so",
            (stage.kinds() != ["broker_lost"], "told"),
        )


def _after_split(stage: Stage, name: str, *wrong: tuple[bool, str]) -> Outcome:
    """What was held up has to come, or the newest fit, which the broker retains."""
    stage.until(stage.is_up_to_date, "the newest fits")
    found = stage.summary()
    replaced, outages = stage.fits - found["fits"], found["outages"]
    return stage.outcome(
        name,
        f"{stage.newest()} of {SENSORS * AXES} axes have their newest fit",
        *wrong,
        (("the broker is back." in stage.said()) != bool(outages), "its return"),
        (replaced < 0 or (replaced > 0 and not outages), f"{found['fits']} of {stage.fits} fits"),
        where={"taken": found["fits"], "replaced by a newer one meanwhile": replaced},
    )


def disk_full(folder: Path) -> Outcome:
    """The history's disk, and room again."""
    with contextlib.closing(SmallDisk(folder / "disk")) as disk:
        history = disk.folder / "fleet.db"
        stage = Stage(folder, "--history", history, "--history-every", "1ms", disk=disk)
        with contextlib.closing(stage):
            disk.attach(stage.fleet.pid)
            stage.publish(1)
            stage.until(stage.is_up_to_date, "the fits")
            disk.fill()
            stage.publish(1)
            stage.until(lambda: stage.kinds() == ["disk_full"], "word of it")
            stage.until(stage.is_up_to_date, "the fits")
            disk.free()
            stage.publish(1)
            stage.until(stage.is_up_to_date, "the fits")
            stage.until(lambda: stage.kinds() == ["disk_full", "history_back"], "room")
            due = stage.fits * AXES
            stage.until(lambda: stage.kept() + stage.summary()["history"]["lost"] >= due, "rows")
            rows, lost = stage.kept(), stage.summary()["history"]["lost"]
            return stage.outcome(
                "history's disk full, later room again",
                f"{due} rows due = {rows} kept + {lost} counted as lost",
                (rows + lost != due, f"{due} rows, {rows} kept, {lost} lost"),
                of="rows of history",
                due=due,
                where={"kept": rows, "counted as lost": lost},
            )


def _rows(path: Path) -> int:
    with contextlib.closing(sqlite3.connect(path, timeout=5)) as database:
        return int(database.execute("SELECT count(*) FROM fit").fetchone()[0])


def fleet_killed(folder: Path) -> Outcome:
    """`kill -9` while it writes its history, and started again."""
    history = folder / "fleet.db"
    with contextlib.closing(Stage(folder, "--history", history, "--history-every", "1ms")) as stage:
        stage.publish(3)
        stage.until(stage.is_up_to_date, "the fits")
        stage.until(lambda: _rows(history) > 0, "rows")
        before = stage.summary()["fits"]
        stage.fleet.kill()
        stage.fleet.wait()
        stage.publish(2)
        rows = _rows(history)
        stage.start_fleet()
        stage.until(stage.is_up_to_date, "the fits")
        return stage.outcome(
            "the fleet's program killed (`kill -9`) and started again",
            f"the newest fit of all {SENSORS * AXES} axes from the broker; {rows} rows in whole fits",
            (rows % AXES != 0, f"{rows} rows are no whole fits"),
            where={
                "taken before": before,
                "replaced by a newer one meanwhile": SENSORS,
                "taken afterwards": stage.summary()["fits"],
            },
        )


def clock_jumps(folder: Path) -> Outcome:
    """The wall clock two days forward, and back."""
    history = folder / "fleet.db"
    with contextlib.closing(
        Stage(folder, "--history", history, "--history-every", "1ms", "--keep", "1h")
    ) as stage:
        stage.publish(1)
        stage.until(lambda: _rows(history) == SENSORS * AXES, "rows")
        for step in (2 * DAY_NS, 0):
            stage.clock.write_bytes(struct.pack("<q", step))
            stage.publish(1)
            stage.until(stage.is_up_to_date, "the fits")
        stage.until(lambda: _rows(history) == 3 * SENSORS * AXES, "rows")
        found = stage.summary()["history"]
        return stage.outcome(
            "clock set two days forward, and back",
            f"{found['clock_jumps']} jumps counted, no row pruned, nobody silent",
            (found["clock_jumps"] != 2, f"{found['clock_jumps']} jumps"),
            (found["pruned"] != 0, f"{found['pruned']} rows pruned"),
            (stage.summary()["states"] != {"online": SENSORS}, "states"),
        )


def twins(folder: Path) -> Outcome:
    """Two programs publish under one name."""
    with contextlib.closing(Stage(folder)) as stage:
        one = stage.sensors[7]
        for turn in range(5):
            for seq in (100 + turn, 90_000 + turn):
                stage.publisher.send(one.device_id, "fit", str(seq).encode().join(one.fit))
                stage.fits += 1
        stage.until(lambda: stage.summary()["fits"] == stage.fits, "the fits")
        stage.until(lambda: stage.summary()["alert_count"] == 1, "the alert")
        (alert,) = stage.summary()["alerts"]
        return stage.outcome(
            "two devices with one id",
            f"alert `{alert['kind']}` of that one alone",
            ((alert["kind"], alert["device_id"]) != ("twins", one.device_id), str(alert)),
        )


def flood(folder: Path) -> Outcome:
    """10,000 messages, each of another device."""
    sent, most = 10_000, 500
    with contextlib.closing(Stage(folder, "--max-sensors", str(most))) as stage:
        stage.publish(1)
        stage.until(stage.is_up_to_date, "the fits")
        earlier = _all_messages(stage)
        for number in range(sent):
            stage.publisher.send(f"made-up-{number}", "status", stage.sensors[0].status, retain=False)
        stage.until_acknowledged()
        stage.until(lambda: stage.summary()["refused"] > 0, "the flood")
        dropped = sent - (_all_messages(stage) - earlier)
        found = stage.summary()
        where = {
            "refused": found["refused"],
            "heard once, and wait": found["candidates"],
            "dropped by the broker": dropped,
        }
        return stage.outcome(
            "10,000 messages, a new device each",
            ", ".join(f"{count} {what}" for what, count in where.items()),
            (found["sensors"] != SENSORS, f"{found['sensors']} sensors"),
            (found["candidates"] > most, "candidates"),
            (not found["refused_names"], "names"),
            of="status",
            due=sent,
            where=where,
        )


def _all_messages(stage: Stage) -> int:
    """How many the fleet has heard, once no more come."""
    before = -1
    while before != (before := stage.summary()["messages"]):
        time.sleep(0.5)
    return before


CASES = (broker_killed, split, long_split, cut_off, disk_full, fleet_killed, clock_jumps, twins, flood)


def play(case: Callable[[Path], Outcome]) -> Outcome:
    """One fault, in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="fleet-fault-") as folder:
        return case(Path(folder))


def line(one: Outcome) -> str:
    """A row of the table."""
    told = ", ".join(one.told) or "–"
    wrong = f" **{'; '.join(one.wrong)}**" if one.wrong else ""
    return f"| {one.name} | {told} | {one.fits} | {one.taken} | {one.account}{wrong} |"


def main() -> int:
    """Play them; 1 if something does not add up."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("words", nargs="*")
    words = parser.parse_args().words
    print("| fault | told | fits published | taken | account |\n|---|---|---|---|---|")
    wrong = 0
    for case in CASES:
        if words and not any(word in case.__name__ for word in words):
            continue
        try:
            outcome = play(case)
        except Skip as why:
            parser.error(str(why))
        wrong += len(outcome.wrong)
        print(line(outcome), flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
