"""Define what is saved of a device's estimators for a later run, and when that snapshot may be used.

A snapshot is used for the same device with the same sensor and settings, if it is not older than `max_age_s`.
Then the estimates of the bias and of R continue from the saved estimates, and the filters continue with their
saved memory. The time since the snapshot is bridged like a gap, by prediction alone, for at most the length
of the memory. The spectral sums of the live fit continue as well, with a break for that time. The record
`epoch` of the first epoch gives `resumed` as the reason for that epoch. A reset of the board since the
snapshot does not matter, since the sensor's noise stays the same. (Opening the port of a Due resets it.)
"""

import msgspec

from fltea._native import CLOCK_TOLERANCE
from fltea.recording.session import Whole
from fltea.records.events import SEQUENCE_WRAP, TIME_WRAP_US
from fltea.records.records import Hello
from fltea.settings.config import Config
from fltea.stream.epoch import Saved

LONGEST_WRAP_S = 30 * 60.0
"""The device's clock starts again from 0 every 71.6 minutes. It shows how many samples are missing since a
snapshot only if the snapshot is not older than this [s].
"""


class LastSample(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Number and device time of the last sample before a snapshot, both with the wraps of the wire protocol.

    `boot_id`: identifier of the device's boot to which they belong.
    """

    boot_id: Whole
    sequence: Whole
    device_us: Whole


class DeviceState(Saved, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The saved estimators of one device.

    `sensor`: values that describe device, sensor and settings. The snapshot is used only if these values are
    still the same. `unix_ns`: Unix time of the last sample [ns]. `last`: the last sample. If the device has
    kept running since the snapshot, the number of this sample shows how many samples are missing.
    """

    sensor: dict[str, str]
    unix_ns: Whole
    last: LastSample | None = None


def missing_since(state: DeviceState, hello: Hello, sequence: int, device_us: int, age_s: float) -> int:
    """Return how many samples are missing between a snapshot and the device's present sample.

    If the device has kept running, the result is the difference of the two samples' numbers. It is used only
    if the device's clock agrees. Otherwise the result is computed from the age of the snapshot, `age_s` [s],
    and the sampling rate.
    """
    known = missing_by_number(state, hello, sequence, device_us, age_s)
    return max(0, round(age_s * hello.rate_hz) - 1) if known is None else known


def missing_by_number(
    state: DeviceState, hello: Hello, sequence: int, device_us: int, age_s: float
) -> int | None:
    """Return how many samples are missing since a snapshot, if sequence numbers show it; else None."""
    last = state.last
    if last is None or last.boot_id != hello.boot_id or age_s > LONGEST_WRAP_S:
        return None
    period_us = 1e6 / hello.rate_hz
    step_us = (device_us - last.device_us) % TIME_WRAP_US
    step = (sequence - last.sequence) % SEQUENCE_WRAP
    step += round((step_us / period_us - step) / SEQUENCE_WRAP) * SEQUENCE_WRAP
    agrees = step >= 1 and abs(step_us - step * period_us) <= CLOCK_TOLERANCE * step * period_us + period_us
    return step - 1 if agrees else None


def sensor_of(hello: Hello, config: Config) -> dict[str, str]:
    """Return values that describe device, sensor and settings.

    A snapshot is used only if all of them are equal.
    """
    return {
        "device_id": str(hello.device_id),
        "who_am_i": str(hello.who_am_i),
        "scales": f"{hello.gyro_lsb_per_dps} {hello.accel_lsb_per_g}",
        "filter_hz": str(hello.gyro_dlpf_hz),
        "rate_hz": str(hello.rate_hz),
        "channels": str(config.channels),
        "live.memory": str(config.live.memory_s),
        "settings": msgspec.json.encode([config.estimator, config.accel]).decode(),
    }


def why_unused(state: DeviceState, hello: Hello, config: Config, now_unix_ns: int) -> str | None:
    """Return the reason why a snapshot cannot be used; None if it can be used."""
    age_s = (now_unix_ns - state.unix_ns) * 1e-9
    if age_s < 0:
        return "it is dated in the future, so the system's clock was probably set back"
    if age_s > config.state.max_age_s:
        return f"it is {age_s:.0f} s old (state.max_age_s is {config.state.max_age_s:g})"
    now = sensor_of(hello, config)
    other = [key for key, value in now.items() if state.sensor.get(key) != value]
    return f"it was made for a device or settings that differ in: {', '.join(other)}" if other else None
