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
    """Return 1/f noise with its corner at 1 Hz, as a sum of relaxations, which passes a filter."""
    words = f"white and 1/f from 1 Hz down ({A_DECADE} relaxations a decade) through {words}"
    part = Through(low_pass, ladder(1e-4, 2 * low_pass.hz, A_DECADE, 1.0))
    return Noise(name, words, "filtered order", (part,))


def _state(alpha: float, f: float, ratio: float, window: int = 0) -> Noise:
    name, words = f"state {alpha:g}, {f:g}, {ratio:g}", ""
    if window:
        name, words = f"{name}, {window}", f", which remembers {window} samples"
    return Noise(
        name,
        f"D^α x = f x + ω in white: α = {alpha:g}, f = {f:g}, s2/R = {ratio:g}{words}",
        "order",
        (W, Fractional(alpha, f, ratio, window)),
    )


def _rounded(sigma: float) -> Noise:
    few = Accepted("constant", "one count in forty differs", 1_000) if sigma < 0.2 else None
    words = f"white noise of σ = {sigma:g} counts, rounded"
    return _white(f"rounded, {sigma:g} LSB", words, rounded(sigma), accepted=few)


CHANGED = Accepted("not stationary", "a burst is a change of the variance")
WHITE = (
    _white("white", "Gaussian white noise"),
    Noise("white, t4", "white noise of Student's t with four degrees", "white", (White("t4"),)),
    Noise("white, Laplace", "white noise of Laplace's distribution", "white", (White("laplace"),)),
    *map(_rounded, (0.1, 0.3, 0.7, 1.0, 5.0)),
    _white("outliers", "white; one sample in 1,000 is 20 σ", outliers),
    _white("bursts", "white; bursts of 20 samples of t2, three times as large", bursts, accepted=CHANGED),
)

MEMS = Relaxation(0.05, 100.0), Relaxation(0.5, 10.0), Relaxation(5.0, 1.0)
RELAXATIONS = (
    _relaxing("1 relaxation", "one at 0.5 Hz in white", Relaxation(0.5, 10.0)),
    _relaxing("2 relaxations", "0.05 and 5 Hz in white", Relaxation(0.05, 100.0), Relaxation(5.0, 3.0)),
    _relaxing("3 relaxations", "0.05, 0.5 and 5 Hz in white: the usual picture of MEMS", *MEMS),
    _relaxing("4 relaxations", "0.01, 0.1, 1 and 10 Hz in white", *_even(0.01, 0.1, 1.0, 10.0)),
    _relaxing("5 relaxations", "0.001 to 10 Hz, one a decade, in white", *_even(0.001, 0.01, 0.1, 1.0, 10.0)),
    _relaxing(
        "2 a decade",
        "relaxations at two a decade from 0.001 to 100 Hz in white: a continuum in practice",
        *ladder(0.001, 100.0, 2.0, 3.0),
    ),
    _relaxing(
        "AR(.99) + AR(.5)",
        "two relaxations at 0.0016 and 0.11 of the rate in white",
        AR1(0.99, 0.05**0.5),
        AR1(0.5, 1.0),
    ),
    _relaxing("slow relaxation", "one at 0.00003 Hz, slower than 3 h, in white", Relaxation(3e-5, 3e7)),
    _relaxing(
        "fast relaxation", "one at 1,500 Hz, beyond half of every rate, in white", Relaxation(1500.0, 10.0)
    ),
)

ORDERS = (
    Noise("ARFIMA d .2", "ARFIMA(0, 0.2, 0)", "order", (Arfima(0.2, 1.0),)),
    Noise("ARFIMA d .4", "ARFIMA(0, 0.4, 0)", "order", (Arfima(0.4, 1.0),)),
    Noise("ARFIMA d -.3", "ARFIMA(0, -0.3, 0)", "rising", (Arfima(-0.3, 1.0),)),
    Noise("ARFIMA(1, .4, 1)", "φ = 0.6, θ = 0.2 in white", "order", (W, Arfima(0.4, 1.0, 0.6, 0.2))),
    Noise("ARFIMA(1, -.3, 1)", "φ = -0.3, θ = -0.2 in white", "rising", (W, Arfima(-0.3, 3.0, -0.3, -0.2))),
    *(
        _state(alpha, f, ratio)
        for alpha, f in ((0.4, -1.0), (0.8, -1.0), (0.8, -10.0), (0.5, 0.0))
        for ratio in (0.3, 3.0)
    ),
    *(
        Noise(f"1/f, {c:g} Hz", f"1/f in white, equally dense at {c:g} Hz", "order", (W, Flicker(c)))
        for c in (0.01, 0.03, 0.3, 1.0, 10.0)
    ),
)

SLOW = (
    Noise("random walk", "equally dense as its white noise at 0.1 Hz", "walk", (W, Walk(0.1))),
    _white("ramp", "white; the offset moves by 3 σ over the record", drift=RAMP),
    _white(
        "warm-up",
        "white; the offset comes to rest with a fifth of the record as time constant, 5 σ in all",
        drift=Drift(5.0, "warm-up"),
    ),
)

LOW_PASSES = (
    *(_filtered(f"1 pole, {c} Hz", f"white through one pole at {c} Hz", LowPass(c)) for c in (5, 20, 41)),
    *(
        _filtered(f"2 poles, {c} Hz", f"white through a Butterworth of two poles at {c} Hz", LowPass(c, 2))
        for c in (5, 20, 41)
    ),
    _filtered("2 poles, 600 Hz", "a Butterworth beyond half of every rate", LowPass(600, 2)),
    _filtered("mean of 4", "white through a moving average of 4", moving_average(4)),
    _filtered("mean of 10", "white through a moving average of 10", moving_average(10)),
    _filtered("windowed sinc", "white through 31 taps that cut at 0.2 of the rate", windowed_sinc(0.2)),
    *(_filtered(f"MPU-9250, {c} Hz", f"white through its DLPF of {c} Hz", mpu9250(c)) for c in MPU9250_DLPF),
    _filtered("1 pole, 20 Hz, ramp", "with a ramp of 3 σ", LowPass(20), drift=RAMP),
    _filtered("2 poles, 20 Hz, walk", "with a random walk behind it", LowPass(20, 2), Walk(0.03)),
    _filtered("mean of 4, ramp", "with a ramp of 3 σ", moving_average(4), drift=RAMP),
    _flicker_before("2 poles, 20 Hz, 1/f", "two poles at 20 Hz", LowPass(20, 2)),
    _flicker_before("1 pole, 41 Hz, 1/f", "one pole at 41 Hz", LowPass(41)),
    Noise(
        "2 poles, 20 Hz, rounded",
        "through two poles at 20 Hz, then rounded, σ = 0.7 counts",
        "low-pass",
        (Through(LowPass(20, 2)),),
        treatment=rounded(0.7),
        spread=1 / 12 / 0.49,
    ),
)

HIGH_PASSES = (
    Noise("AC, 0.1 Hz", "white behind one pole at 0.1 Hz, as AC coupling", "high-pass", (Coupled(0.1),)),
    Noise(
        "AC, 1 Hz, 2 poles",
        "white behind two poles at 1 Hz",
        "high-pass",
        (Coupled(1.0, 2),),
        accepted=Accepted("notch", "of a fifth of the rate, 150 samples do not tell it from a notch", 200),
    ),
    Noise("auto-zero", "white less its mean of the last 5 s", "high-pass", (AutoZeroed(5.0),)),
    Noise(
        "AC, relaxation",
        "one at 0.5 Hz in white, all of it behind one pole at 0.05 Hz",
        "high-passed relaxations",
        (Coupled(0.05, 1, (Relaxation(0.5, 10.0),)),),
    ),
)

HUM = (Line(50.02, 0.5), Line(100.04, 0.25), Line(150.06, 0.15))
PEAKS = (
    *(
        Noise(
            f"resonance, Q {q}",
            f"Q = {q} at 0.12 of the rate in white",
            "resonance",
            (W, Resonance(0.12, q, 20.0)),
        )
        for q in (3, 10, 50)
    ),
    _white("line", "a sine of 0.3 σ at 0.23 of the rate", lines=(Line(0.2301, 0.3, "rate"),)),
    _white(
        "line at the end", "a sine of 0.5 σ 0.03 Hz below half the rate", lines=(Line(0.03, 0.5, "nyquist"),)
    ),
    _white("slow line", "a sine of 0.5 σ at 0.03 Hz", lines=(Line(0.03, 0.5),)),
    _white("hum", "50.02 Hz of 0.5 σ, folded", lines=HUM[:1]),
    _white("hum, harmonics", "50.02 Hz of 0.5 σ with its second and third harmonic, folded", lines=HUM),
)

ODD = (
    Noise("differenced", "differences of white noise, in white", "rising", (W, Differenced(1.0))),
    _white("variance wanders", "white; its variance goes up and down by a factor of 2", wander, changes=True),
    _white(
        "swing, 2,000 × 2", "white; σ doubles for every other 2,000 samples", swinging(2000, 2), swings=2000
    ),
    _white("swing, 250 × 1.5", "white; σ × 1.5 for every other 250 samples", swinging(250, 1.5), swings=250),
    _white("dead band", "white; what is within ± 1.5 σ is 0", dead_band(1.5), check="dead band"),
    _relaxing("telegraph", "± 20, which changes its sign every 2 s or so, in white", Telegraph(2.0, 20.0)),
    _white("variance steps", "white; its variance doubles in the middle", step, changes=True),
    Noise(
        "every 10th repeated", "white; each tenth sample is read twice", "held", (Held((*range(9), 8), 10),)
    ),
    Noise(
        "slow chip", "white; two values of the chip for five readings", "held", (Held((0, 0, 0, 1, 1), 2),)
    ),
    Noise(
        "jitter",
        "a relaxation at 5 Hz, read up to half a period late, in white",
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
        "0.16, 1.6 and 8 Hz in white, read as differences of a rounded angle",
        *CLOSE,
        ANGLE,
    ),
    Noise(
        "3 relaxations, sharpened",
        "0.05, 0.5 and 5 Hz in white, all through -0.04, 1.08, -0.04",
        "relaxations",
        (Through(SHARPENING, MEMS),),
    ),
    _relaxing("relaxation, MA", "one at 0.5 Hz in white and differences of white", MEMS[1], Differenced(0.2)),
    Noise(
        "relaxation, AR(-.2)",
        "one at 0.5 Hz in AR(1) of the coefficient -0.2",
        "relaxations",
        (MEMS[1], AR1(-0.2, 1.0)),
    ),
    Noise(
        "walk, angle",
        "random walk, read as differences of a rounded angle",
        "walk",
        (Walk(0.1), Differenced(1.0)),
    ),
    Noise("notch", "white through a notch of Q = 5 at 0.25 of the rate", "notch", (Notched(0.25, 5.0),)),
)

FROM_PRACTICE = (
    _white("comb, 1 s", "a sample of 5 σ each second", lines=(Glitches(1.0, 5.0),)),
    _white(
        "comb, .37 s",
        "two samples of 4 σ each 0.371 s, up to a sample early or late",
        lines=(Glitches(0.37123, 4.0, 2, 1),),
    ),
    _white(
        "wandering hum",
        "a sine of 3 σ about 50 Hz, whose frequency wanders by 0.1 Hz in 5 s",
        lines=(WanderingLine(50.0, 3.0, 0.1, 5.0),),
    ),
    _filtered("flight controller", "white through two poles at 20 Hz and a notch", FlightFilter(20.0, 2)),
    Noise("median of 5", "white through the median of 5 samples", "held", (Median(5),)),
)

NOISES = {
    one.name: one
    for one in (
        *(*WHITE, *RELAXATIONS, *ORDERS, *SLOW, *LOW_PASSES, *HIGH_PASSES),
        *(*PEAKS, *ODD, *RISING, *FROM_PRACTICE),
    )
}
"""All noises by name."""
