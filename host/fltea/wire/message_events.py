"""Converts messages of the wire protocol to events, whose values are in physical units instead of counts."""

from enum import IntEnum

from fltea.records.events import DeviceAxis, DeviceBins, DeviceEstimator, DeviceFit, DeviceTracker
from fltea.records.records import Hello
from fltea.records.stats import DeviceStatus
from fltea.wire import layout as wire
from fltea.wire.sensors import sensor_name

_FIELDS = wire.Estimate._fields
CAUSES = _FIELDS[_FIELDS.index("order_box") : _FIELDS.index("tracker_bias")]
"""Fields of ESTIMATE that count how often the guard, which keeps the filters from diverging, corrected them.
The estimator on the host uses the same names for its counters.
"""

BINS = sum(field.startswith("frequency_") for field in wire.Spectrum._fields)
"""Number of bins in one SPECTRUM message."""


def hello_event(hello: wire.Hello, source: str, host_ns: int) -> Hello:
    """Return the event of a HELLO message, with the message's integers converted to physical units."""

    def scaled(name: str) -> float:
        # rounded, so that a raw value of 164 in units of 0.1 gives exactly 16.4
        return float(round(getattr(hello, name) * wire.Hello.SCALE[name], 9))

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
    """Return the event of a STATUS message, with the message's integers converted to physical units.

    Every pass of the device's main loop takes more than 0 µs. A `longest_step` of 0 µs therefore means that
    the device has not measured any time, and the event has no processor times.
    """
    return DeviceStatus(
        *s[:5],
        reset_cause=name_of(wire.ResetCause, s.reset_cause),
        cpu_share_percent=round(s.cpu_share * wire.Status.SCALE["cpu_share"], 2) if s.longest_step else None,
        longest_step_us=s.longest_step or None,
    )


def axis_event(e: wire.Estimate, sequence: int, host_ns: int) -> DeviceAxis:
    """Return the event of an ESTIMATE message. `sequence`: sequence number of the message's frame."""
    flags = wire.EstimateFlags
    return DeviceAxis(
        sequence=sequence,
        host_ns=host_ns,
        axis=name_of(wire.Axis, e.axis),
        sample=e.sample,
        age=e.age,
        valid=bool(e.flags & flags.VALID),
        constant=bool(e.flags & flags.CONSTANT),
        missing=bool(e.flags & flags.MISSING),
        skipped=bool(e.flags & flags.SKIPPED),
        tuned=bool(e.flags & flags.TUNED),
        alpha=e.alpha,
        alpha_std=e.alpha_std,
        f=e.f,
        f_std=e.f_std,
        state_dps=e.state,
        innovation_dps=e.innovation,
        interventions={cause: n for cause in CAUSES if (n := getattr(e, cause))},
        tracker=DeviceTracker(e.tracker_bias, e.tracker_bias_std, e.tracker_state, e.tracker_state_std)
        if e.flags & flags.TRACKED
        else None,
    )


def estimator_event(e: wire.Estimator, host_ns: int) -> DeviceEstimator:
    """Return the event of an ESTIMATOR message."""
    return DeviceEstimator(
        host_ns=host_ns,
        variant=name_of(wire.EstimatorVariant, e.variant),
        guard=name_of(wire.EstimatorGuard, e.guard),
        startup=e.startup,
        max_gap=e.max_gap,
        every=e.every,
        remaining=e.remaining,
        begun=e.begun,
        fit_every=e.fit_every,
        queue=e.queue,
        skipped=e.skipped,
        longest_axis_us=e.longest_axis,
        longest_slice_us=e.longest_slice,
        restarts=(e.restarts_x, e.restarts_y, e.restarts_z),
        bias_dps=(e.bias_x, e.bias_y, e.bias_z),
        R_dps2=(e.r_x, e.r_y, e.r_z),
        state_x0=e.state_x0,
        state_P0=e.state_p0,
        state_Q=e.state_q,
        alpha0=e.alpha0,
        alpha_P0=e.alpha_p0,
        alpha_Q0=e.alpha_q0,
        alpha_delta=e.alpha_delta,
        parameter0=e.parameter0,
        parameter_P0=e.parameter_p0,
        parameter_Q0=e.parameter_q0,
        parameter_delta=e.parameter_delta,
        gate=e.gate,
    )


def fit_event(fit: wire.Fit, host_ns: int) -> DeviceFit:
    """Return the event of a FIT message."""
    flags = wire.FitFlags
    return DeviceFit(
        host_ns=host_ns,
        axis=name_of(wire.Axis, fit.axis),
        verdict=name_of(wire.FitVerdict, fit.verdict),
        alpha_defined=bool(fit.flags & flags.ALPHA_DEFINED),
        searched=bool(fit.flags & flags.SEARCHED),
        bins_left_out=bool(fit.flags & flags.BINS_LEFT_OUT),
        tuned=bool(fit.flags & flags.TUNED),
        number=fit.number,
        age=fit.age,
        samples=fit.used,
        evaluations=fit.evaluations,
        ordinates=fit.ordinates,
        alpha=fit.alpha,
        alpha_std=fit.alpha_std,
        f=fit.f,
        s2_dps2=fit.s2,
        R_dps2=fit.r,
        ratio_white=fit.ratio_white,
        ratio_relaxation=fit.ratio_relaxation,
    )


def bins_event(s: wire.Spectrum, host_ns: int) -> DeviceBins:
    """Return the event of a SPECTRUM message.

    The last message of a spectrum may have unused bins at its end, which are left out.
    """
    n = max(0, min(BINS, s.total - s.first))
    hz, ordinates, density = (
        tuple(getattr(s, f"{name}_{i}") for i in range(n)) for name in ("frequency", "ordinates", "density")
    )
    return DeviceBins(host_ns, name_of(wire.Axis, s.axis), s.number, s.first, s.total, hz, ordinates, density)


def name_of(enum: type[IntEnum], value: int) -> str:
    """Return the name of an enum's value in lower case, or "unknown (N)" for an undefined number N."""
    try:
        return enum(value).name.lower()
    except ValueError:
        return f"unknown ({value})"
