"""Publishes frames of many sensors to a broker, for `fltea run -s mqtt:…`.

Run `python -m tools.frames_load --broker mqtt://127.0.0.1`. Once a second, each sensor publishes a message
with a second of white noise on `fltea/NAME/frames`; the messages of all sensors are spread evenly over the
second. The duration and the numbers of devices and messages are limited, and only a broker on this machine is
accepted. At the end, a JSON object with the counts of published messages is printed. `--made-up N`: N more
messages a second, each under a name of its own. `--flood N`: N more messages a second from one device.
`--mqtt-311`: MQTT 3.1.1, which NATS speaks.
"""

import argparse
import json
import time
from typing import Any

import numpy as np
from fltea.settings.outputs import is_loopback
from fltea.wire import layout as wire
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from tools.made_up_board import HELLO, MadeUpBoard, frames

RATE_HZ = 100
LONGEST_S, MOST_DEVICES, MOST_A_SECOND = 600, 10_000, 20_000
VOICES = 8
"""Number of different sequences of noise. Devices with the same noise differ only in their HELLO."""


class Sensors:
    """The messages of many sensors; each sensor has one message a second."""

    def __init__(self, devices: int, seed: int = 1) -> None:
        self.names = [f"s{k:05d}" for k in range(devices)]
        self._boards = [MadeUpBoard(_hello(k)) for k in range(devices)]
        self._voices = [MadeUpBoard() for _ in range(VOICES)]
        self._rngs = [np.random.default_rng((seed, k)) for k in range(VOICES)]
        self._second = -1
        self._samples: list[bytes] = []

    def message(self, k: int, second: int) -> bytes:
        """Return the message of sensor `k` for second number `second`: HELLO and that second's samples."""
        if second != self._second:
            self._second = second
            self._samples = [self._speak(voice, second) for voice in range(VOICES)]
        self._boards[k].instant = second * RATE_HZ
        return frames(self._boards[k].greets()) + self._samples[k % VOICES]

    def _speak(self, voice: int, second: int) -> bytes:
        """Return the frames of one second of samples, with noise sequence number `voice`."""
        board, noise = self._voices[voice], self._rngs[voice].normal(0, 3, (RATE_HZ, 3))
        board.instant = second * RATE_HZ
        return frames(board.sample(gyro) for gyro in np.rint(noise).astype(int).tolist())


def _hello(k: int) -> wire.Hello:
    return HELLO._replace(boot_id=k + 1, device_id=k.to_bytes(16, "big"), firmware_version="load")


def run(host: str, port: int, version: MQTTProtocolVersion, given: argparse.Namespace) -> dict[str, Any]:
    """Publish in real time. Return the counts of messages, and the longest delay of a message."""
    client = Client(CallbackAPIVersion.VERSION2, "", protocol=version)
    client.max_inflight_messages_set(0)
    client.connect(host, port)
    client.loop_start()
    devices, seconds, sensors = given.devices, given.seconds, Sensors(given.devices)
    begin_s, published, extra, late_s = time.monotonic(), 0, 0, 0.0
    slots = max(devices, 1)
    for second in range(seconds):
        for k in range(slots):
            due_s = begin_s + second + k / slots
            if (left_s := due_s - time.monotonic()) > 0:
                time.sleep(left_s)
            late_s = max(late_s, -left_s)
            if k < devices:
                client.publish(f"fltea/{sensors.names[k]}/frames", sensors.message(k, second), qos=1)
                published += 1
            for rate, names in ((given.made_up, None), (given.flood, "flood")):
                for _ in range(rate * (k + 1) // slots - rate * k // slots):
                    client.publish(f"fltea/{names or f'u{extra:09d}'}/frames", b"\1" * 100, qos=0)
                    extra += 1
    deadline_s = time.monotonic() + 10
    while client._out_messages and time.monotonic() < deadline_s:
        time.sleep(0.01)
    unacknowledged = len(client._out_messages)
    client.disconnect()
    client.loop_stop()
    return {
        "devices": devices,
        "seconds": seconds,
        "messages": published,
        "samples": published * RATE_HZ,
        "unacknowledged": unacknowledged,
        "extra_messages": extra,
        "late_s": round(late_s, 3),
    }


def main() -> None:
    """Run the command line: refuse values above the limits, and publish."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--broker", default="mqtt://127.0.0.1:1883", help="a broker on this machine")
    parser.add_argument("--devices", type=int, default=200)
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--made-up", type=int, default=0, help="messages a second under names of their own")
    parser.add_argument("--flood", type=int, default=0, help="messages a second of one device")
    parser.add_argument("--mqtt-311", action="store_true", help="MQTT 3.1.1, for NATS")
    given = parser.parse_args()
    host, _, port = given.broker.removeprefix("mqtt://").partition(":")
    if not is_loopback(host):
        parser.error(f"{host}: only this machine's own broker is loaded, such as 127.0.0.1")
    for name, most in (("devices", MOST_DEVICES), ("seconds", LONGEST_S)):
        if not 0 <= getattr(given, name) <= most:
            parser.error(f"--{name}: at most {most}")
    if not 0 <= given.made_up + given.flood <= MOST_A_SECOND:
        parser.error(f"--made-up and --flood: at most {MOST_A_SECOND} a second together")
    version = MQTTProtocolVersion.MQTTv311 if given.mqtt_311 else MQTTProtocolVersion.MQTTv5
    print(json.dumps(run(host, int(port or 1883), version, given)))


if __name__ == "__main__":
    main()
