"""A device without hardware: sends protocol frames at 100 Hz on a pseudo-terminal, with noise of known order.

The device boots whenever a program opens the port, as a Due does: it sends 0x00, HELLO, then samples. A
program empties the port just after opening it. A Due has not booted by then, but this device has. It
therefore boots again if the program empties the port after the first bytes. The samples are quantised like
those of an MPU-9250 at ±2000 deg/s. With --estimate the device also sends estimates of its own. The first
line on standard output has the port's name.
"""

import argparse
import secrets
import signal
import struct
import sys
import time
from pathlib import Path

from fltea.records.errors import UsageError
from fltea.records.version import __version__
from fltea.sources.synthetic import NoiseGenerator, NoiseSettings, parse_noise
from fltea.wire import layout as wire

from tools.made_up_board import HELLO, STATUS, MadeUpBoard, frames
from tools.own_estimator import JOINT, OwnEstimator
from tools.pty_port import PtyPort

POLL_S = 0.02
OPENING_S = 0.3
"""Longest time [s] that a program is expected to take from opening the port to emptying it. A Due takes
longer than this to boot.
"""


class Device(MadeUpBoard):
    """A simulated board whose samples are noise of known order.

    `estimate`: whether the board also sends estimates that it computes from its samples.
    """

    def __init__(self, settings: NoiseSettings, boot_id: int, *, estimate: bool = False) -> None:
        hello = HELLO._replace(
            boot_id=boot_id,
            device_id=b"fltea stand-in".ljust(16, b"\0"),
            firmware_version=f"{__version__} stand-in",
            sample_rate=round(settings.rate_hz * 1000),
            gyro_range=round(settings.range_dps),
            gyro_lsb=round(settings.lsb_per_dps * 10),
            sampling_mode=wire.SamplingMode.SIMULATED,
        )
        own = OwnEstimator(JOINT, settings.lsb_per_dps, 1 / settings.rate_hz) if estimate else None
        super().__init__(hello, status=STATUS, rate_hz=settings.rate_hz, own=own)
        self._noise = NoiseGenerator(settings)
        self.dropped_frames = 0

    def next_frames(self) -> bytes:
        """Return the frames of one sampling instant."""
        self.status = STATUS._replace(dropped_frames=self.dropped_frames)
        return frames(self.tick([int(count) for count in self._noise.step()]))


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--noise", default="", metavar="KEY=VALUE&…", help="as in synthetic:?… of 'fltea run'"
    )
    parser.add_argument(
        "--link", type=Path, help="make a symbolic link to the port, under a name of your own"
    )
    parser.add_argument(
        "--estimate", action="store_true", help="also send the estimates that the device computes"
    )
    parser.add_argument(
        "--samples", type=int, default=0, help="number of samples after which each boot falls silent"
    )
    return parser.parse_args()


def main() -> int:
    """Serve one client after another until interrupted."""
    arguments = parse_arguments()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        settings = parse_noise(arguments.noise)
        if settings.lsb_per_dps < 0.1 or settings.rate_hz < 1:
            raise UsageError("a device sends counts (lsb_per_dps ≥ 0.1), at 1 Hz or more.")
        Device(settings, boot_id=0).booted()
        port = PtyPort(arguments.link)
    except UsageError as error:
        print(f"standin: error: {error}", file=sys.stderr)
        return 2
    except struct.error as error:
        print(f"standin: error: HELLO cannot state these settings ({error}).", file=sys.stderr)
        return 2
    name = arguments.link or port.name
    print(f"{name}: α {settings.alpha:g}, f {settings.f:g}, {settings.rate_hz:g} Hz", flush=True)
    try:
        while True:
            while not port.is_open:
                time.sleep(POLL_S)
            serve(
                port, Device(settings, secrets.randbits(32), estimate=arguments.estimate), arguments.samples
            )
    except KeyboardInterrupt:
        return 0
    finally:
        port.close()


def serve(port: PtyPort, device: Device, limit: int) -> None:
    """Boot, and send in real time until the client closes the port or another opening empties it.

    The caller then calls this function again, with a new boot.
    """
    opened_s = time.monotonic()
    while not port.was_emptied() and time.monotonic() < opened_s + OPENING_S:
        time.sleep(POLL_S)
    begin_s = time.monotonic()
    port.send(device.booted())
    while port.is_open and not port.was_emptied():
        if limit and device.instant >= limit:
            time.sleep(POLL_S)
            continue
        time.sleep(max(0.0, begin_s + device.device_us * 1e-6 - time.monotonic()))
        data = device.next_frames()
        if not port.send(data):
            device.dropped_frames += data.count(0)


if __name__ == "__main__":
    sys.exit(main())
