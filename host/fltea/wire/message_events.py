"""Messages as events: raw counts become values in their units (protocol/README.md)."""

from enum import IntEnum

from fltea.records.events import DeviceAxis, DeviceBins, DeviceEstimator, DeviceFit, DeviceTracker
from fltea.records.records import DeviceStatus, Hello
from fltea.wire import layout as wire
from fltea.wire.sensors import sensor_name

_FIELDS = wire.Estimate._fields
CAUSES = _FIELDS[_FIELDS.index("order_box") : _FIELDS.index("tracker_bias")]
"""Fields of ESTIMATE that count what the guard did; the host's engine has the same names."""

BINS = sum(field.startswith("frequency_") for field in wire.Spectrum._fields)
"""The number of bins in one SPECTRUM."""


def hello_event(hello: wire.Hello, source: str, host_ns: int) -> Hello:
    """Return HELLO's counts in their units."""

    def scaled(name: str) -> float:
        return float(round(getattr(hello, name) * wire.Hello.SCALE[name], 9))  # 164 * 0.1 is 16.4

    return Hello(
        source=source,
        host_ns=host_ns,
        rate_hz=scaled("sample_rate"),
        sampling_mode=name_of(wire.SamplingMode, hello.sampling_mode),
        protocol=f"{hello.protocol_major}.{hello.protocol_minor}",
        schema_hash=f"0x{hello.schema_hash:08X}",
        boot_id=hello.boot_id,
        device_id=hello.device_id.hex(),
        firmware_version=hello.firmware_version,
        who_am_i=hello.who_am_i,
        sensor=sensor_name(hello.who_am_i),
        sensor_starts=hello.sensor_starts,
        gyro_range_dps=scaled("gyro_range"),
        gyro_lsb_per_dps=scaled("gyro_lsb"),
        accel_range_g=scaled("accel_range"),
        accel_lsb_per_g=scaled("accel_lsb"),
        gyro_dlpf_hz=scaled("gyro_dlpf"),
    )


def status_event(s: wire.Status) -> DeviceStatus:
    """Return STATUS's counts in their units.

    No turn of a loop takes 0 us, so that means that none was measured.
    """
    return DeviceStatus(
        *s[:5],
        reset_cause=name_of(wire.ResetCause, s.reset_cause),
        cpu_share_percent=round(s.cpu_share * wire.Status.SCALE["cpu_share"], 2) if s.longest_step else None,
        longest_step_us=s.longest_step or None,
    )


def axis_event(e: wire.Estimate, sequence: int, host_ns: int) -> DeviceAxis:
    """Return ESTIMATE with its flags by name; sequence is that of its frame."""
    flags = wire.EstimateFlags
    known = flags.VALID, flags.CONSTANT, flags.MISSING, flags.SKIPPED, flags.TUNED
    counts = {cause: n for cause in CAUSES if (n := getattr(e, cause))}
    tracker = DeviceTracker(*e[-4:]) if e.flags & flags.TRACKED else None
    valid, constant, missing, skipped, tuned = (bool(e.flags & flag) for flag in known)
    place = sequence, host_ns, name_of(wire.Axis, e.axis), e.sample, e.age
    return DeviceAxis(*place, valid, constant, missing, skipped, tuned, *e[4:10], counts, tracker)


def estimator_event(e: wire.Estimator, host_ns: int) -> DeviceEstimator:
    """Return ESTIMATOR with its settings by name, and with what is of each axis together."""
    names = name_of(wire.EstimatorVariant, e.variant), name_of(wire.EstimatorGuard, e.guard)
    return DeviceEstimator(host_ns, *names, *e[2:12], e[12:15], e[15:18], e[18:21], *e[21:])


def fit_event(fit: wire.Fit, host_ns: int) -> DeviceFit:
    """Return FIT with its flags by name."""
    flags = wire.FitFlags
    known = flags.ALPHA_DEFINED, flags.SEARCHED, flags.BINS_LEFT_OUT, flags.TUNED
    defined, searched, left_out, tuned = (bool(fit.flags & flag) for flag in known)
    names = name_of(wire.Axis, fit.axis), name_of(wire.FitVerdict, fit.verdict)
    return DeviceFit(host_ns, *names, defined, searched, left_out, tuned, *fit[3:7], *fit[7:])


def bins_event(s: wire.Spectrum, host_ns: int) -> DeviceBins:
    """Return SPECTRUM's bins without those beyond the last one."""
    n = max(0, min(BINS, s.total - s.first))
    hz, ordinates, density = (
        tuple(getattr(s, f"{name}_{i}") for i in range(n)) for name in ("frequency", "ordinates", "density")
    )
    return DeviceBins(host_ns, name_of(wire.Axis, s.axis), s.number, s.first, s.total, hz, ordinates, density)


def name_of(enum: type[IntEnum], value: int) -> str:
    """Return the name of an enum's value in lower case; the number itself for one that we do not know."""
    try:
        return enum(value).name.lower()
    except ValueError:
        return f"unknown ({value})"
