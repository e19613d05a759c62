"""Boards that publish their samples by MQTT, from one thread and over one connection."""

import contextlib
import threading

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from tools.faults.program import wait_until
from tools.frames_load import RATE_HZ, Sensors

DEVICES = 8
EVERY_S = 0.5
"""From message to message of a board. Each holds a second of samples: twice as fast as real boards."""


class Boards:
    """Publish a second of samples each, again and again, from a thread.

    qos: with 1 what is not acknowledged is sent again. seconds: how many each has published.
    """

    def __init__(self, port: int, qos: int) -> None:
        self._qos = qos
        self._sensors = Sensors(DEVICES)
        self.names = self._sensors.names
        self.seconds = 0
        self._client = Client(CallbackAPIVersion.VERSION2, "boards", protocol=MQTTProtocolVersion.MQTTv311)
        self._client.max_inflight_messages_set(1)  # else the library changes their order after an outage
        self._client.reconnect_delay_set(1, 1)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    @property
    def samples(self) -> int:
        """How many each has published."""
        return self.seconds * RATE_HZ

    def start(self) -> None:
        """Begin to publish."""
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(EVERY_S):
            for k, name in enumerate(self.names):
                self._client.publish(
                    f"fltea/{name}/frames", self._sensors.message(k, self.seconds), qos=self._qos
                )
            self.seconds += 1

    def stop(self) -> None:
        """Publish no more; comes back when the server has all that waited."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        with contextlib.suppress(TimeoutError):
            wait_until(lambda: not self._client._out_messages, "acknowledgements")

    def close(self) -> None:
        """Leave."""
        self.stop()
        self._client.disconnect()
        self._client.loop_stop()
