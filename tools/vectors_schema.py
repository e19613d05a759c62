"""The text of the schema hash, typed by hand, and the layouts that follow from it (protocol/README.md).

`make_vectors.py` builds its frames on it. So nothing in the vectors comes from `protocol/messages.toml` or
from the generator: a slip there, or here, shows as another hash or as other bytes.
"""

import zlib

BIN = """\
field frequency_{0} f32 unit Hz
field ordinates_{0} f32
field density_{0} f32 unit (deg/s)^2/Hz
"""
SCHEMA = f"""\
message 1 HELLO
field protocol_major u8
field protocol_minor u8
field schema_hash u32
field boot_id u32
field device_id bytes16
field firmware_version text24
field who_am_i u8
field sensor_starts u16
field sample_rate u32 scale 0.001 unit Hz
field gyro_range u16 scale 1 unit deg/s
field gyro_lsb u16 scale 0.1 unit LSB per deg/s
field accel_range u16 scale 1 unit g
field accel_lsb u16 scale 1 unit LSB per g
field gyro_dlpf u16 scale 1 unit Hz
field sampling_mode u8 enum sampling_mode
message 2 SAMPLE
field gyro_x i16 unit LSB
field gyro_y i16 unit LSB
field gyro_z i16 unit LSB
field accel_x i16 unit LSB
field accel_y i16 unit LSB
field accel_z i16 unit LSB
field temperature i16 unit LSB
field flags u8 flags sample_flags
message 3 STATUS
field i2c_errors u32
field bus_recoveries u32
field sensor_reinits u32
field overruns u32
field dropped_frames u32
field reset_cause u8 enum reset_cause
field cpu_share u16 scale 0.01 unit %
field longest_step u32 unit us
message 4 FAULT
field code u8 enum fault_code
field detail u32
message 5 ESTIMATE
field axis u8 enum axis
field flags u8 flags estimate_flags
field sample u16
field age u32
field alpha f32
field alpha_std f32
field f f32 unit s^-alpha
field f_std f32 unit s^-alpha
field state f32 unit deg/s
field innovation f32 unit deg/s
field order_box u32
field order_sigma u32
field order_variance u32
field order_gate u32
field parameter_box u32
field parameter_variance u32
field parameter_gate u32
field state_bound u32
field memory_order u32
field tracker_bias f32 unit deg/s
field tracker_bias_std f32 unit deg/s
field tracker_state f32 unit deg/s
field tracker_state_std f32 unit deg/s
message 6 ESTIMATOR
field variant u8 enum estimator_variant
field guard u8 enum estimator_guard
field startup u16
field max_gap u16
field every u16
field remaining u16
field begun u16
field fit_every u16
field queue u16
field skipped u32
field longest_axis u32 unit us
field longest_slice u32 unit us
field restarts_x u16
field restarts_y u16
field restarts_z u16
field bias_x f32 unit deg/s
field bias_y f32 unit deg/s
field bias_z f32 unit deg/s
field r_x f32 unit (deg/s)^2
field r_y f32 unit (deg/s)^2
field r_z f32 unit (deg/s)^2
field state_x0 f32 unit deg/s
field state_p0 f32 unit (deg/s)^2
field state_q f32 unit (deg/s)^2
field alpha0 f32
field alpha_p0 f32
field alpha_q0 f32
field alpha_delta f32
field parameter0 f32
field parameter_p0 f32
field parameter_q0 f32
field parameter_delta f32
field gate f32
message 7 FIT
field axis u8 enum axis
field verdict u8 enum fit_verdict
field flags u8 flags fit_flags
field number u16
field age u32
field used u32
field evaluations u16
field ordinates f32
field alpha f32
field alpha_std f32
field f f32 unit s^-alpha
field s2 f32 unit (deg/s)^2
field r f32 unit (deg/s)^2
field ratio_white f32
field ratio_relaxation f32
message 8 SPECTRUM
field axis u8 enum axis
field number u16
field first u8
field total u8
{"".join(map(BIN.format, range(5)))}enum sampling_mode
value 0 timer
value 1 data_ready
value 2 fifo
value 3 simulated
enum reset_cause
value 0 power_up
value 1 backup
value 2 watchdog
value 3 software
value 4 user
value 255 unknown
enum fault_code
value 1 sensor_missing
value 2 sensor_unknown
value 3 readback_mismatch
value 4 bus_held
value 5 sensor_lost
value 6 data_ready_missing
value 7 sensor_frozen
enum axis
value 0 gyro_x
value 1 gyro_y
value 2 gyro_z
enum estimator_variant
value 0 triple
value 1 joint
enum estimator_guard
value 0 off
value 1 faithful
value 2 consistent
enum fit_verdict
value 0 none
value 1 white
value 2 fractional
value 3 relaxation
flags sample_flags
bit 0 late
bit 1 retried
bit 2 saturated
bit 3 repeated
flags estimate_flags
bit 0 valid
bit 1 constant
bit 2 missing
bit 3 skipped
bit 4 tuned
bit 5 tracked
flags fit_flags
bit 0 alpha_defined
bit 1 searched
bit 2 bins_left_out
bit 3 tuned
"""
HASH = zlib.crc32(SCHEMA.encode())

CODES = {"u8": "B", "u16": "H", "u32": "I", "i16": "h", "f32": "f", "bytes16": "16s", "text24": "24s"}
"""Type -> code of Python's struct."""


def layouts() -> dict[int, list[tuple[str, str]]]:
    """Type byte -> name and type of each field, in the order of the wire."""
    found: dict[int, list[tuple[str, str]]] = {}
    fields: list[tuple[str, str]] = []
    for line in SCHEMA.splitlines():
        word, first, *rest = line.split()
        if word == "message":
            fields = found[int(first)] = []
        elif word == "field":
            fields.append((first, rest[0]))
    return found
