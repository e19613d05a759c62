"""Faults of the ingest from an MQTT broker, with one program: the broker away, the line cut."""

import time
from functools import partial

from tools.faults.case import Case, Outcome
from tools.faults.ingest_scene import BrokerScene, outcome, until_all_again
from tools.faults.stage import Stage

AWAY_S = 8.0


def broker_killed(stage: Stage, *, away_s: float) -> Outcome:
    """The broker is killed, and started again after some seconds."""
    scene = BrokerScene(stage)
    scene.broker.kill()
    time.sleep(away_s)
    scene.broker.start()
    back_s = time.monotonic()
    until_all_again(scene.boards, scene.workers)
    more = f"samples of all sensors again {time.monotonic() - back_s:.0f} s after it was back"
    return outcome(scene.boards, scene.workers, more)


def program_cut_off(stage: Stage) -> Outcome:
    """The network between it and the broker is split until it reports so; boards go on."""
    scene = BrokerScene(stage)
    (program,) = scene.workers
    scene.line.cut()
    cut_s = time.monotonic()
    program.wait_for(lambda: "broker_lost" in program.errors(), "word of it")
    reported_s = time.monotonic() - cut_s
    scene.line.heal()
    until_all_again(scene.boards, scene.workers)
    return outcome(scene.boards, scene.workers, f"reported after {reported_s:.0f} s")


CASES = (
    Case("MQTT broker killed (`kill -9`), started again at once", partial(broker_killed, away_s=0.0)),
    Case(f"MQTT broker away for {AWAY_S:g} s", partial(broker_killed, away_s=AWAY_S)),
    Case("cut off from the MQTT broker until it was reported", program_cut_off),
)
