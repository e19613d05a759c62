"""Faults of what `fltea fleet` depends on: broker, network, disk, clock and sensors."""

import math
import time
from functools import partial

from tools.faults.case import Case
from tools.faults.expected import SOME, Expected
from tools.faults.fleet_scene import AXES, SENSORS, FleetScene
from tools.faults.outcome import LOST, Outcome
from tools.faults.stage import Stage

DAY_NS = 86_400 * 10**9
SHORT_SPLIT_S, LONG_SPLIT_S = 2.0, 60.0
FIT_EVERY_S = 10.0


def broker_killed(stage: Stage) -> Outcome:
    """Kill the broker with SIGKILL, and start it again."""
    scene = FleetScene(stage)
    scene.publish(2)
    time.sleep(1.5)  # Wait until the broker has saved its messages, which it does once a second.
    scene.broker.kill()
    scene.until(lambda: not scene.is_connected(), "the loss")
    scene.broker.start()
    scene.until(scene.is_connected, "the connection")
    scene.publish(2)
    missed = scene.fits - scene.summary()["fits"]
    return scene.outcome(
        f"{scene.newest()} of {SENSORS * AXES} axes have their newest fit",
        (missed > 0, f"{missed} fits missed"),
        (scene.summary()["outages"] != 1, "outages"),
    )


def split(stage: Stage, *, seconds: float, lasts: bool) -> Outcome:
    """Suspend the process of the broker, so that no connection passes data.

    `seconds`: shortest duration of the suspension. `lasts`: whether the broker also stays suspended until the
    fleet has reported that the broker is lost.
    """
    scene = FleetScene(stage)
    scene.publish(1)
    scene.broker.pause()
    end_s = time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0:
        scene.send()
        time.sleep(min(FIT_EVERY_S, left_s))
    if lasts:
        scene.until(lambda: "broker_lost" in scene.kinds(), "word of it")
    reported = scene.kinds()
    scene.broker.go_on()
    scene.until_acknowledged()
    scene.until(scene.is_connected, "the connection")
    return _after_split(
        scene,
        (("broker_lost" in reported) != lasts, f"reported meanwhile: {reported}"),
        (scene.summary()["outages"] != int(lasts), "outages"),
    )


def cut_off(stage: Stage) -> Outcome:
    """Cut only the connection between fleet and broker, until the fleet has reported the loss.

    The fleet reports the loss after one to two keepalive periods of 15 s.
    """
    scene = FleetScene(stage, behind_line=True)
    scene.publish(1)
    scene.line.cut()
    scene.publish(1, arrive=False)
    scene.until(lambda: "broker_lost" in scene.kinds(), "word of it")
    scene.publish(2, arrive=False)
    scene.line.heal()
    scene.until(scene.is_connected, "the connection")
    return _after_split(scene, (scene.kinds() != ["broker_lost"], "reported"))


def _after_split(scene: FleetScene, *wrong: tuple[bool, str]) -> Outcome:
    """Check that all delayed fits arrive, or at least the newest fit of each axis, which the broker retains.

    Return the outcome.
    """
    scene.until_up_to_date()
    found = scene.summary()
    replaced, outages = scene.fits - found["fits"], found["outages"]
    return scene.outcome(
        f"{scene.newest()} of {SENSORS * AXES} axes have their newest fit",
        *wrong,
        (("the broker is back." in scene.fleet.stderr) != bool(outages), "its return"),
        # While the fleet is cut off, the broker keeps only the newest fit of each axis. The fleet may miss
        # all other fits, but not those of the first round: it received these before it was cut off.
        (
            not 0 <= replaced <= (scene.fits - SENSORS if outages else 0),
            f"{found['fits']} of {scene.fits} fits",
        ),
        where={"taken": found["fits"], "replaced by a newer one meanwhile": replaced},
    )


def disk_full(stage: Stage) -> Outcome:
    """Fill the disk on which the fleet's history is, and free the space again."""
    disk = stage.disk("disk")
    scene = FleetScene(stage, history=disk.folder, disk=disk)
    disk.attach(scene.fleet.process.pid)
    scene.publish(1)
    disk.fill()
    scene.publish(1, arrive=False)
    scene.until(lambda: scene.kinds() == ["disk_full"], "word of it")
    scene.until_up_to_date()
    disk.free()
    scene.publish(1)
    scene.until(lambda: scene.kinds() == ["disk_full", "history_back"], "room")
    due = scene.fits * AXES
    scene.until(lambda: scene.shown() + scene.summary()["history"]["lost"] >= due, "rows")
    where = {"kept": scene.shown(), LOST: scene.summary()["history"]["lost"]}
    return scene.outcome("", of="rows of history", due=due, where=where)


def fleet_killed(stage: Stage) -> Outcome:
    """Kill the fleet while it writes its history, and start it again."""
    scene = FleetScene(stage, history=stage.folder)
    scene.publish(3)
    scene.until(lambda: scene.rows() > 0, "rows")
    before = scene.summary()["fits"]
    scene.fleet.kill()
    scene.publish(2, arrive=False)
    rows = scene.rows()
    scene.start_fleet()
    scene.until_up_to_date()
    return scene.outcome(
        f"the newest fit of all {SENSORS * AXES} axes from the broker; {rows} rows in whole fits",
        (rows % AXES != 0, f"{rows} rows are no whole fits"),
        where={
            "taken before": before,
            "replaced by a newer one meanwhile": SENSORS,
            "taken afterwards": scene.summary()["fits"],
        },
    )


def clock_jumps(stage: Stage) -> Outcome:
    """Set the machine's date two days forward, and back again."""
    scene = FleetScene(stage, "--keep", "1h", history=stage.folder)
    scene.publish(1, arrive=False)
    scene.until(lambda: scene.rows() == SENSORS * AXES, "rows")
    for ahead_ns in (2 * DAY_NS, 0):
        stage.set_clock(ahead_ns)
        scene.publish(1)
    scene.until(lambda: scene.rows() == 3 * SENSORS * AXES, "rows")
    found = scene.summary()["history"]
    return scene.outcome(
        f"{found['clock_jumps']} jumps counted, no row pruned, no sensor silent",
        (found["clock_jumps"] != 2, f"{found['clock_jumps']} jumps"),
        (found["pruned"] != 0, f"{found['pruned']} rows pruned"),
        (scene.summary()["states"] != {"online": SENSORS}, "states"),
    )


def twins(stage: Stage) -> Outcome:
    """Let two programs publish under the same device name."""
    scene = FleetScene(stage)
    one = scene.sensors[7]
    for turn in range(5):
        for seq in (100 + turn, 90_000 + turn):
            scene.publisher.send(one.device_id, "fit", str(seq).encode().join(one.fit))
            scene.fits += 1
    scene.until(lambda: scene.summary()["fits"] == scene.fits, "the fits")
    scene.until(lambda: scene.summary()["alert_count"] == 1, "the alert")
    (alert,) = scene.summary()["alerts"]
    return scene.outcome(
        f"alert `{alert['kind']}` of that one alone",
        ((alert["kind"], alert["device_id"]) != ("twins", one.device_id), str(alert)),
    )


def flood(stage: Stage) -> Outcome:
    """Send 10,000 messages, each from another device."""
    sent, most = 10_000, 500
    scene = FleetScene(stage, "--max-sensors", str(most))
    scene.publish(1)
    earlier = _all_messages(scene)
    for number in range(sent):
        scene.publisher.send(f"made-up-{number}", "status", scene.sensors[0].status, retain=False)
    scene.until_acknowledged()
    scene.until(lambda: scene.summary()["refused"] > 0, "the flood")
    dropped = sent - (_all_messages(scene) - earlier)
    found = scene.summary()
    where = {
        "refused": found["refused"],
        "waiting for a second message": found["candidates"],
        "dropped by the broker": dropped,
    }
    return scene.outcome(
        "",
        (found["sensors"] != SENSORS, f"{found['sensors']} sensors"),
        (found["candidates"] > most, f"{found['candidates']} wait for a second message"),
        (not found["refused_names"], "names"),
        of="status",
        due=sent,
        where=where,
    )


def _all_messages(scene: FleetScene) -> int:
    """Wait until no more messages arrive; return how many the fleet has received."""
    before = -1
    while before != (before := scene.summary()["messages"]):
        time.sleep(0.5)
    return before


CASES = (
    Case(
        "broker killed (`kill -9`) and started again",
        broker_killed,
        Expected(("broker_lost",), due=4 * SENSORS),
    ),
    Case(
        f"network split for {SHORT_SPLIT_S:g} s",
        partial(split, seconds=SHORT_SPLIT_S, lasts=False),
        Expected(due=2 * SENSORS),
    ),
    Case(
        f"network split for {LONG_SPLIT_S:g} s",
        partial(split, seconds=LONG_SPLIT_S, lasts=True),
        Expected(("broker_lost",), due=(SENSORS, math.inf), excused=SOME),
        tested=False,
    ),
    Case(
        "the fleet cut off from the broker until it reports it",
        cut_off,
        Expected(("broker_lost",), due=4 * SENSORS, excused=(0, 3 * SENSORS)),
        tested=False,
    ),
    Case(
        "history's disk full, later room again",
        disk_full,
        Expected(("disk_full", "history_back"), due=3 * SENSORS * AXES, lost=(0, SENSORS * AXES)),
    ),
    Case(
        "the fleet's program killed (`kill -9`) and started again",
        fleet_killed,
        Expected(due=5 * SENSORS, excused=2 * SENSORS),
    ),
    Case("clock set two days forward, and back", clock_jumps, Expected(due=3 * SENSORS)),
    Case("two devices with one id", twins, Expected(due=10)),
    Case("10,000 messages, a new device each", flood, Expected(due=10_000, excused=(500, 10_000))),
)
