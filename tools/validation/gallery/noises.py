"""The noises of the gallery. Frequencies are in Hz unless the words call them a share of the rate."""

from tools.validation.gallery.additions import (
    Bursts,
    Drift,
    Held,
    Jittered,
    Line,
    Outliers,
    Repeated,
    Rounded,
    Step,
    Wander,
)
from tools.validation.gallery.filters import (
    MPU9250_DLPF,
    Butterworth2,
    OneRealPole,
    Through,
    moving_average,
    mpu9250,
    windowed_sinc,
)
from tools.validation.gallery.noise import Noise, named
from tools.validation.gallery.parts import (
    A_DECADE,
    AR1,
    Arfima,
    Differenced,
    Flicker,
    Fractional,
    Ladder,
    Relaxation,
    Resonance,
    Walk,
    White,
)

W = White()
MEMS = (Relaxation(0.05, 100.0), Relaxation(0.5, 10.0), Relaxation(5.0, 1.0))

WHITE = (
    Noise("white", "Gaussian white noise", "white", (W,)),
    Noise("white, t4", "white noise of Student's t with four degrees", "white", (White("t4"),)),
    Noise("white, Laplace", "white noise of Laplace's distribution", "white", (White("laplace"),)),
    *(
        Noise(
            f"rounded, {s:g} LSB",
            f"white noise of σ = {s:g} counts, rounded",
            "white",
            (W,),
            treatment=Rounded(s),
        )
        for s in (0.1, 0.3, 0.7, 1.0, 5.0)
    ),
    Noise("outliers", "white; one sample in 1,000 is 20 σ", "white", (W,), treatment=Outliers()),
    Noise(
        "bursts", "white; bursts of 20 samples of t2, three times as large", "white", (W,), treatment=Bursts()
    ),
)

RELAXATIONS = (
    Noise("1 relaxation", "one at 0.5 Hz in white", "relaxations", (W, Relaxation(0.5, 10.0))),
    Noise(
        "2 relaxations",
        "0.05 and 5 Hz in white",
        "relaxations",
        (W, Relaxation(0.05, 100.0), Relaxation(5.0, 3.0)),
    ),
    Noise(
        "3 relaxations", "0.05, 0.5 and 5 Hz in white: the usual picture of MEMS", "relaxations", (W, *MEMS)
    ),
    Noise(
        "4 relaxations",
        "0.01, 0.1, 1 and 10 Hz in white",
        "relaxations",
        (W, *(Relaxation(c, 5 / c) for c in (0.01, 0.1, 1.0, 10.0))),
    ),
    Noise(
        "5 relaxations",
        "0.001 to 10 Hz, one a decade, in white",
        "relaxations",
        (W, *(Relaxation(c, 5 / c) for c in (0.001, 0.01, 0.1, 1.0, 10.0))),
    ),
    Noise(
        "2 a decade",
        "relaxations at two a decade from 0.001 to 100 Hz in white: a continuum in practice",
        "relaxations",
        (W, Ladder(0.001, 100.0, 2.0, 3.0)),
    ),
    Noise(
        "AR(.99) + AR(.5)",
        "two relaxations at 0.0016 and 0.11 of the rate in white",
        "relaxations",
        (W, AR1(0.99, 0.05), AR1(0.5, 1.0)),
    ),
    Noise(
        "slow relaxation",
        "one at 0.00003 Hz, slower than 3 h, in white",
        "relaxations",
        (W, Relaxation(3e-5, 3e7)),
    ),
    Noise(
        "fast relaxation",
        "one at 1,500 Hz, beyond half of every rate, in white",
        "relaxations",
        (W, Relaxation(1500.0, 10.0)),
    ),
)

ORDERS = (
    Noise("ARFIMA d .2", "ARFIMA(0, 0.2, 0)", "order", (Arfima(0.2, 1.0),)),
    Noise("ARFIMA d .4", "ARFIMA(0, 0.4, 0)", "order", (Arfima(0.4, 1.0),)),
    Noise("ARFIMA d -.3", "ARFIMA(0, -0.3, 0)", "rising", (Arfima(-0.3, 1.0),)),
    Noise("ARFIMA(1, .4, 1)", "φ = 0.6, θ = 0.2 in white", "order", (W, Arfima(0.4, 1.0, 0.6, 0.2))),
    Noise("ARFIMA(1, -.3, 1)", "φ = -0.3, θ = -0.2 in white", "rising", (W, Arfima(-0.3, 3.0, -0.3, -0.2))),
    *(
        Noise(
            f"state {alpha:g}, {f:g}, {ratio:g}",
            f"D^α x = f x + ω in white: α = {alpha:g}, f = {f:g}, s2/R = {ratio:g}",
            "order",
            (W, Fractional(alpha, f, ratio)),
        )
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
    Noise("ramp", "white; the offset moves by 3 σ over the record", "white", (W,), drift=Drift(3.0)),
    Noise(
        "warm-up",
        "white; the offset comes to rest with a fifth of the record as time constant, 5 σ in all",
        "white",
        (W,),
        drift=Drift(5.0, "exponential"),
    ),
)


def _flicker_before(filter_hz: float) -> tuple[Relaxation, ...]:
    """1/f noise with its corner at 1 Hz, as a sum, that a filter has in front of it."""
    return Ladder(1e-4, 2 * filter_hz, A_DECADE, 1.0).steps


LOW_PASSES = (
    *(
        Noise(f"1 pole, {c} Hz", f"white through one pole at {c} Hz", "low-pass", (Through(OneRealPole(c)),))
        for c in (5, 20, 41)
    ),
    *(
        Noise(
            f"2 poles, {c} Hz",
            f"white through a Butterworth of two poles at {c} Hz",
            "low-pass",
            (Through(Butterworth2(c)),),
        )
        for c in (5, 20, 41)
    ),
    Noise(
        "2 poles, 600 Hz",
        "a Butterworth beyond half of every rate",
        "low-pass",
        (Through(Butterworth2(600)),),
    ),
    Noise("mean of 4", "white through a moving average of 4", "low-pass", (Through(moving_average(4)),)),
    Noise("mean of 10", "white through a moving average of 10", "low-pass", (Through(moving_average(10)),)),
    Noise(
        "windowed sinc",
        "white through 31 taps that cut at 0.2 of the rate",
        "low-pass",
        (Through(windowed_sinc(0.2)),),
    ),
    *(
        Noise(f"MPU-9250, {c} Hz", f"white through its DLPF of {c} Hz", "low-pass", (Through(mpu9250(c)),))
        for c in MPU9250_DLPF
    ),
    Noise(
        "1 pole, 20 Hz, ramp", "with a ramp of 3 σ", "low-pass", (Through(OneRealPole(20)),), drift=Drift(3.0)
    ),
    Noise(
        "2 poles, 20 Hz, walk",
        "with a random walk behind it",
        "low-pass",
        (Through(Butterworth2(20)), Walk(0.03)),
    ),
    Noise(
        "mean of 4, ramp", "with a ramp of 3 σ", "low-pass", (Through(moving_average(4)),), drift=Drift(3.0)
    ),
    Noise(
        "2 poles, 20 Hz, 1/f",
        f"white and 1/f from 1 Hz down ({A_DECADE} relaxations a decade) through two poles at 20 Hz",
        "filtered order",
        (Through(Butterworth2(20), _flicker_before(20)),),
    ),
    Noise(
        "1 pole, 41 Hz, 1/f",
        f"white and 1/f from 1 Hz down ({A_DECADE} relaxations a decade) through one pole at 41 Hz",
        "filtered order",
        (Through(OneRealPole(41), _flicker_before(41)),),
    ),
    Noise(
        "2 poles, 20 Hz, rounded",
        "through two poles at 20 Hz, then rounded, σ = 0.7 counts",
        "low-pass",
        (Through(Butterworth2(20)),),
        treatment=Rounded(0.7),
        spread=1 / 12 / 0.49,
    ),
)

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
    Noise("line", "a sine of 0.3 σ at 0.23 of the rate", "white", (W,), lines=(Line(0.2301, 0.3, "rate"),)),
    Noise(
        "line at the end",
        "a sine of 0.5 σ 0.03 Hz below half the rate",
        "white",
        (W,),
        lines=(Line(0.03, 0.5, "nyquist"),),
    ),
    Noise("slow line", "a sine of 0.5 σ at 0.03 Hz", "white", (W,), lines=(Line(0.03, 0.5),)),
    Noise("hum", "50.02 Hz of 0.5 σ, folded", "white", (W,), lines=(Line(50.02, 0.5),)),
    Noise(
        "hum, harmonics",
        "50.02 Hz of 0.5 σ with its second and third harmonic, folded",
        "white",
        (W,),
        lines=(Line(50.02, 0.5), Line(100.04, 0.25), Line(150.06, 0.15)),
    ),
)

ODD = (
    Noise("differenced", "differences of white noise, in white", "rising", (W, Differenced(1.0))),
    Noise(
        "variance wanders",
        "white; its variance goes up and down by a factor of 2",
        "white",
        (W,),
        treatment=Wander(),
        changes=True,
    ),
    Noise(
        "variance steps",
        "white; its variance doubles in the middle",
        "white",
        (W,),
        treatment=Step(),
        changes=True,
    ),
    Noise("every 10th repeated", "white; each tenth sample is read twice", "held", (Repeated(),)),
    Noise("slow chip", "white; two values of the chip for five readings", "held", (Held(),)),
    Noise(
        "jitter",
        "a relaxation at 5 Hz, read up to half a period late, in white",
        "relaxations",
        (Jittered(5.0, 10.0),),
    ),
)

NOISES = named((*WHITE, *RELAXATIONS, *ORDERS, *SLOW, *LOW_PASSES, *PEAKS, *ODD))
"""All, by name."""
