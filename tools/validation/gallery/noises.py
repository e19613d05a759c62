"""The noises of the gallery.

Frequencies are in Hz, except those that are called "divided by the sample rate".
"""

from typing import Any

from tools.validation.gallery.filters import (
    MPU9250_DLPF,
    FlightFilter,
    Held,
    Jittered,
    LowPass,
    Median,
    Through,
    moving_average,
    mpu9250,
    windowed_sinc,
)
from tools.validation.gallery.high_passes import AutoZeroed, Coupled
from tools.validation.gallery.noise import (
    Accepted,
    Drift,
    Line,
    Noise,
    Treatment,
    bursts,
    dead_band,
    outliers,
    rounded,
    step,
    swinging,
    wander,
)
from tools.validation.gallery.parts import (
    A_DECADE,
    AR1,
    Arfima,
    Differenced,
    Flicker,
    Fractional,
    Notched,
    Part,
    Relaxation,
    Resonance,
    Telegraph,
    Walk,
    White,
    ladder,
)
from tools.validation.gallery.periodic import Glitches, WanderingLine

W = White()
RAMP = Drift(3.0)


def _white(name: str, words: str, treatment: Treatment | None = None, **more: Any) -> Noise:
    return Noise(name, words, "white", (W,), treatment=treatment, **more)


def _relaxing(name: str, words: str, *parts: Part) -> Noise:
    return Noise(name, words, "relaxations", (W, *parts))


def _even(*corners_hz: float) -> tuple[Relaxation, ...]:
    return tuple(Relaxation(corner, 5 / corner) for corner in corners_hz)


def _filtered(name: str, words: str, low_pass: LowPass, *behind: Part, drift: Drift | None = None) -> Noise:
    return Noise(name, words, "low-pass", (Through(low_pass), *behind), drift=drift)


def _flicker_before(name: str, words: str, low_pass: LowPass) -> Noise:
    """Return white noise plus 1/f noise (a sum of relaxations), both after a low-pass.

    The 1/f noise is the stronger one below 1 Hz.
    """
    words = f"white noise plus 1/f noise below 1 Hz ({A_DECADE} relaxations a decade), after {words}"
    part = Through(low_pass, ladder(1e-4, 2 * low_pass.hz, A_DECADE, 1.0))
    return Noise(name, words, "filtered order", (part,))


def _state(alpha: float, f: float, ratio: float, window: int = 0) -> Noise:
    name, words = f"state {alpha:g}, {f:g}, {ratio:g}", ""
    if window:
        name, words = f"{name}, {window}", f", which remembers {window} samples"
    return Noise(
        name,
        f"D^α x = f x + ω in white noise: α = {alpha:g}, f = {f:g}, s2/R = {ratio:g}{words}",
        "order",
        (W, Fractional(alpha, f, ratio, window)),
    )


def _rounded(sigma: float) -> Noise:
    few = Accepted("constant", "one count in forty differs", 1_000) if sigma < 0.2 else None
    words = f"white noise of σ = {sigma:g} counts, rounded"
    return _white(f"rounded, {sigma:g} LSB", words, rounded(sigma), accepted=few)


CHANGED = Accepted("not stationary", "the variance is larger during a burst")
WHITE = (
    _white("white", "Gaussian white noise"),
    Noise("white, t4", "white noise with Student's t of four degrees of freedom", "white", (White("t4"),)),
    Noise("white, Laplace", "white noise with Laplace's distribution", "white", (White("laplace"),)),
    *map(_rounded, (0.1, 0.3, 0.7, 1.0, 5.0)),
    _white("outliers", "white noise; one sample in 1,000 is 20 σ", outliers),
    _white("bursts", "white noise; bursts of 20 samples, 3 times Student's t", bursts, accepted=CHANGED),
)

MEMS = Relaxation(0.05, 100.0), Relaxation(0.5, 10.0), Relaxation(5.0, 1.0)
RELAXATIONS = (
    _relaxing("1 relaxation", "one relaxation at 0.5 Hz in white noise", Relaxation(0.5, 10.0)),
    _relaxing(
        "2 relaxations",
        "relaxations at 0.05 and 5 Hz in white noise",
        Relaxation(0.05, 100.0),
        Relaxation(5.0, 3.0),
    ),
    _relaxing(
        "3 relaxations",
        "relaxations at 0.05, 0.5 and 5 Hz in white noise, as many MEMS gyroscopes show them",
        *MEMS,
    ),
    _relaxing(
        "4 relaxations", "relaxations at 0.01, 0.1, 1 and 10 Hz in white noise", *_even(0.01, 0.1, 1.0, 10.0)
    ),
    _relaxing(
        "5 relaxations",
        "relaxations at 0.001 to 10 Hz, one in each decade, in white noise",
        *_even(0.001, 0.01, 0.1, 1.0, 10.0),
    ),
    _relaxing(
        "2 a decade",
        "relaxations from 0.001 to 100 Hz, two in each decade, in white noise: almost a continuum",
        *ladder(0.001, 100.0, 2.0, 3.0),
    ),
    _relaxing(
        "AR(.99) + AR(.5)",
        "relaxations at 0.0016 and 0.11 of the sample rate in white noise",
        AR1(0.99, 0.05**0.5),
        AR1(0.5, 1.0),
    ),
    _relaxing("slow relaxation", "relaxation at 0.00003 Hz (over 3 h) in white noise", Relaxation(3e-5, 3e7)),
    _relaxing(
        "fast relaxation",
        "one relaxation at 1,500 Hz, above half of each sample rate, in white noise",
        Relaxation(1500.0, 10.0),
    ),
)

ORDERS = (
    Noise("ARFIMA d .2", "ARFIMA(0, 0.2, 0)", "order", (Arfima(0.2, 1.0),)),
    Noise("ARFIMA d .4", "ARFIMA(0, 0.4, 0)", "order", (Arfima(0.4, 1.0),)),
    Noise("ARFIMA d -.3", "ARFIMA(0, -0.3, 0)", "rising", (Arfima(-0.3, 1.0),)),
    Noise("ARFIMA(1, .4, 1)", "φ = 0.6, θ = 0.2 in white noise", "order", (W, Arfima(0.4, 1.0, 0.6, 0.2))),
    Noise(
        "ARFIMA(1, -.3, 1)",
        "ARFIMA with φ = -0.3, θ = -0.2 in white noise",
        "rising",
        (W, Arfima(-0.3, 3.0, -0.3, -0.2)),
    ),
    *(
        _state(alpha, f, ratio)
        for alpha, f in ((0.4, -1.0), (0.8, -1.0), (0.8, -10.0), (0.5, 0.0))
        for ratio in (0.3, 3.0)
    ),
    *(
        Noise(f"1/f, {c:g} Hz", f"1/f noise, as dense as white noise at {c:g} Hz", "order", (W, Flicker(c)))
        for c in (0.01, 0.03, 0.3, 1.0, 10.0)
    ),
)

SLOW = (
    Noise("random walk", "random walk, as dense as the white noise at 0.1 Hz", "walk", (W, Walk(0.1))),
    _white("ramp", "white noise; the offset moves by 3 σ during the record", drift=RAMP),
    _white(
        "warm-up",
        "white noise; the offset moves by 5 σ, with a time constant of a fifth of the record",
        drift=Drift(5.0, "warm-up"),
    ),
)

LOW_PASSES = (
    *(
        _filtered(f"1 pole, {c} Hz", f"white noise after a low-pass of one pole at {c} Hz", LowPass(c))
        for c in (5, 20, 41)
    ),
    *(
        _filtered(
            f"2 poles, {c} Hz", f"white noise after a Butterworth of two poles at {c} Hz", LowPass(c, 2)
        )
        for c in (5, 20, 41)
    ),
    _filtered("2 poles, 600 Hz", "white noise after a low-pass above half of each rate", LowPass(600, 2)),
    _filtered("mean of 4", "white noise after a moving average of 4 samples", moving_average(4)),
    _filtered("mean of 10", "white noise after a moving average of 10 samples", moving_average(10)),
    _filtered(
        "windowed sinc",
        "white noise after a filter of 31 taps with its corner at 0.2 of the sample rate",
        windowed_sinc(0.2),
    ),
    *(
        _filtered(f"MPU-9250, {c} Hz", f"white noise after the low-pass of {c} Hz in an MPU-9250", mpu9250(c))
        for c in MPU9250_DLPF
    ),
    _filtered("1 pole, 20 Hz, ramp", "low-passed white noise plus a ramp of 3 σ", LowPass(20), drift=RAMP),
    _filtered(
        "2 poles, 20 Hz, walk", "low-passed white noise plus a random walk", LowPass(20, 2), Walk(0.03)
    ),
    _filtered("mean of 4, ramp", "averaged white noise plus a ramp of 3 σ", moving_average(4), drift=RAMP),
    _flicker_before("2 poles, 20 Hz, 1/f", "a low-pass of two poles at 20 Hz", LowPass(20, 2)),
    _flicker_before("1 pole, 41 Hz, 1/f", "a low-pass of one pole at 41 Hz", LowPass(41)),
    Noise(
        "2 poles, 20 Hz, rounded",
        "white noise after a low-pass of two poles at 20 Hz, rounded, σ = 0.7 counts",
        "low-pass",
        (Through(LowPass(20, 2)),),
        treatment=rounded(0.7),
        spread=1 / 12 / 0.49,
    ),
)

HIGH_PASSES = (
    Noise(
        "AC, 0.1 Hz",
        "white noise after a high-pass of one pole at 0.1 Hz, as with AC coupling",
        "high-pass",
        (Coupled(0.1),),
    ),
    Noise(
        "AC, 1 Hz, 2 poles",
        "white noise after a high-pass of two poles at 1 Hz",
        "high-pass",
        (Coupled(1.0, 2),),
        accepted=Accepted(
            "notch", "at a fifth of the sample rate, 150 samples cannot tell it from a notch", 200
        ),
    ),
    Noise("auto-zero", "white noise minus its mean over the last 5 s", "high-pass", (AutoZeroed(5.0),)),
    Noise(
        "AC, relaxation",
        "one relaxation at 0.5 Hz and white noise, both after a high-pass of one pole at 0.05 Hz",
        "high-passed relaxations",
        (Coupled(0.05, 1, (Relaxation(0.5, 10.0),)),),
    ),
)

HUM = (Line(50.02, 0.5), Line(100.04, 0.25), Line(150.06, 0.15))
PEAKS = (
    *(
        Noise(
            f"resonance, Q {q}",
            f"resonance of Q = {q} at 0.12 of the sample rate in white noise",
            "resonance",
            (W, Resonance(0.12, q, 20.0)),
        )
        for q in (3, 10, 50)
    ),
    _white("line", "white noise and a sine of 0.3 σ at 0.23 of the rate", lines=(Line(0.2301, 0.3, "rate"),)),
    _white(
        "line at the end",
        "white noise plus a sine of 0.5 σ, 0.03 Hz below half the sample rate",
        lines=(Line(0.03, 0.5, "nyquist"),),
    ),
    _white("slow line", "white noise plus a sine of 0.5 σ at 0.03 Hz", lines=(Line(0.03, 0.5),)),
    _white("hum", "white noise plus a sine of 0.5 σ at 50.02 Hz, aliased", lines=HUM[:1]),
    _white("hum, harmonics", "white noise, sine of 0.5 σ at 50.02 Hz, two harmonics, aliased", lines=HUM),
)

ODD = (
    Noise("differenced", "white noise plus differences of white noise", "rising", (W, Differenced(1.0))),
    _white("variance wanders", "white noise; σ² rises and falls by a factor of 2", wander, changes=True),
    _white(
        "swing, 2,000 × 2",
        "white noise; σ is doubled in every second group of 2,000 samples",
        swinging(2000, 2),
        swings=2000,
    ),
    _white(
        "swing, 250 × 1.5",
        "white noise; σ is 1.5 times as large in every second group of 250 samples",
        swinging(250, 1.5),
        swings=250,
    ),
    _white("dead band", "white noise; values within ± 1.5 σ are set to 0", dead_band(1.5), check="dead band"),
    _relaxing("telegraph", "white noise plus ± 20; the sign changes about every 2 s", Telegraph(2.0, 20.0)),
    _white("variance steps", "white noise; σ² doubles in the middle of the record", step, changes=True),
    Noise(
        "every 10th repeated",
        "white noise; every tenth reading repeats the value before it",
        "held",
        (Held((*range(9), 8), 10),),
    ),
    Noise("slow chip", "white noise; two new values for five readings", "held", (Held((0, 0, 0, 1, 1), 2),)),
    Noise(
        "jitter",
        "a relaxation at 5 Hz, read up to half a period late, in white noise",
        "relaxations",
        (Jittered(5.0, 10.0),),
    ),
)

ANGLE = Differenced(0.08)
"""The gyroscope's rate is the difference of two successive angles. Here these angles are quantised."""
CLOSE = Relaxation(0.16, 24.0), Relaxation(1.6, 2.4), Relaxation(8.0, 0.5)
SHARPENING = LowPass(taps=(-0.04, 1.08, -0.04))
RISING = (
    *(_state(0.35, -4.0, ratio) for ratio in (0.5, 3.0)),
    _state(0.3, -1.8, 1.0),
    _state(0.35, 0.3, 3.0, window=300),
    _relaxing(
        "3 relaxations, angle",
        "relaxations at 0.16, 1.6 and 8 Hz in white noise, read as differences of a rounded angle",
        *CLOSE,
        ANGLE,
    ),
    Noise(
        "3 relaxations, sharpened",
        "relaxations at 0.05, 0.5 and 5 Hz in white noise, after a filter of taps -0.04, 1.08, -0.04",
        "relaxations",
        (Through(SHARPENING, MEMS),),
    ),
    _relaxing(
        "relaxation, MA",
        "one relaxation at 0.5 Hz, white noise, and differences of white noise",
        MEMS[1],
        Differenced(0.2),
    ),
    Noise(
        "relaxation, AR(-.2)",
        "one relaxation at 0.5 Hz in AR(1) noise with the coefficient -0.2",
        "relaxations",
        (MEMS[1], AR1(-0.2, 1.0)),
    ),
    Noise(
        "walk, angle",
        "random walk, read as differences of a rounded angle",
        "walk",
        (Walk(0.1), Differenced(1.0)),
    ),
    Noise("notch", "white noise after a notch of Q = 5 at 0.25 of the rate", "notch", (Notched(0.25, 5.0),)),
)

FROM_PRACTICE = (
    _white("comb, 1 s", "white noise plus 5 σ in one sample of each second", lines=(Glitches(1.0, 5.0),)),
    _white(
        "comb, .37 s",
        "white noise plus 4 σ in two samples every 0.371 s, up to one sample early or late",
        lines=(Glitches(0.37123, 4.0, 2, 1),),
    ),
    _white(
        "wandering hum",
        "white noise plus a sine of 3 σ whose frequency wanders about 50 Hz, by 0.1 Hz within 5 s",
        lines=(WanderingLine(50.0, 3.0, 0.1, 5.0),),
    ),
    _filtered(
        "flight controller",
        "white noise after a low-pass of two poles at 20 Hz and a notch",
        FlightFilter(20.0, 2),
    ),
    Noise("median of 5", "white noise after a median filter of 5 samples", "held", (Median(5),)),
)

NOISES = {
    one.name: one
    for one in (
        *(*WHITE, *RELAXATIONS, *ORDERS, *SLOW, *LOW_PASSES, *HIGH_PASSES),
        *(*PEAKS, *ODD, *RISING, *FROM_PRACTICE),
    )
}
"""All noises by name."""
