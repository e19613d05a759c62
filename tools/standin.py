"""A device without hardware: sends protocol frames at 100 Hz on a pseudo-terminal, with noise of known order.

It boots whenever a program opens the port, as a Due does: 0x00, HELLO, then samples. A Due takes longer to
boot than a program takes to open the port; this device boots again if the program empties the port after the
first bytes. Its samples are quantised like those of an MPU-9250 at ±2000 deg/s. With --estimate it also sends
estimates of its own. Its first line on standard output names the port.
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
from own_estimator import JOINT, OwnEstimator

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # needed when the file is run directly

from tools.board_voice import HELLO, Voice
from tools.pty_port import PtyPort

POLL_S = 0.02
OPENING_S = 0.3
"""Time [s] within which a program that opens the port empties it: less than a Due takes to boot."""
ACCEL_1G = 16384
TEMPERATURE_25C = round((25.0 - 21.0) * 333.87)


class Device:
    """What the firmware would send, sample by sample. Its time is the number of samples over the rate.

    `estimate`: it also sends the estimates that it computes from its samples.
    """

    def __init__(self, settings: NoiseSettings, boot_id: int, *, estimate: bool = False) -> None:
        self._settings = settings
        self._noise = NoiseGenerator(settings)
        self._boot_id = boot_id
        self._voice = Voice()
        self.samples = 0
        self.dropped_frames = 0
        self._own = OwnEstimator(JOINT, settings.lsb_per_dps, 1 / settings.rate_hz) if estimate else None

    @property
    def device_us(self) -> int:
        """Time of the next sample [us since boot]."""
        return round(self.samples * 1e6 / self._settings.rate_hz)

    def boot(self) -> bytes:
        """Return the bytes of a boot: 0x00, which ends any unfinished frame, then HELLO."""
        return b"\0" + self._frame(self._hello()) + self._estimator()

    def tick(self) -> bytes:
        """Return the frames of one sampling instant; HELLO and STATUS are added once a second."""
        gyro = x, y, z = [int(count) for count in self._noise.step()]
        sequence = self._voice.next_sample()
        frames = self._frame(wire.Sample(x, y, z, 0, 0, ACCEL_1G, TEMPERATURE_25C, 0))
        if self._own is not None:
            frames += b"".join(map(self._frame, self._own.step(gyro, sequence)))
        if self.samples % round(self._settings.rate_hz) == 0:
            frames += self._frame(self._hello())
            frames += self._frame(wire.Status(0, 0, 0, 0, self.dropped_frames, wire.ResetCause.USER, 0, 0))
            frames += self._estimator()
        self.samples += 1
        return frames

    def _estimator(self) -> bytes:
        return self._frame(self._own.stated) if self._own is not None else b""

    def _frame(self, message: wire.Message) -> bytes:
        return self._voice.says(message, self.device_us)

    def _hello(self) -> wire.Hello:
        s = self._settings
        return HELLO._replace(
            boot_id=self._boot_id,
            device_id=b"fltea stand-in".ljust(16, b"\0"),
            firmware_version=f"{__version__} stand-in",
            sample_rate=round(s.rate_hz * 1000),
            gyro_range=round(s.range_dps),
            gyro_lsb=round(s.lsb_per_dps * 10),
            sampling_mode=wire.SamplingMode.SIMULATED,
        )


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
    parser.add_argument("--estimate", action="store_true", help="send estimates of its own too")
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
        Device(settings, boot_id=0).boot()
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
    """Send in real time until the client closes the port, or discards the device's first bytes."""
    opened_s = time.monotonic()
    while not port.was_emptied() and time.monotonic() < opened_s + OPENING_S:
        time.sleep(POLL_S)
    begin_s = time.monotonic()
    port.send(device.boot())
    while port.is_open and not port.was_emptied():
        if limit and device.samples >= limit:
            time.sleep(POLL_S)
            continue
        time.sleep(max(0.0, begin_s + device.device_us * 1e-6 - time.monotonic()))
        frames = device.tick()
        if not port.send(frames):
            device.dropped_frames += frames.count(0)


if __name__ == "__main__":
    sys.exit(main())
