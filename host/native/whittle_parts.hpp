// The table of noise parts, which are the terms of noise models, such as white noise, a relaxation or a
// filter. Search, fit and intervals, and also Python (host/fltea/noise/part.py), take everything that they
// need to know about a part from this table.
//
// A new part needs a number in Part and a row in kTable here, its spectrum in whittle_spectra.hpp, and a
// class in host/fltea/noise/parts.py. Tests need examples of it, and validation a population.
// host/CHANGING.md lists all places, and which compiler or test reports each one that is missing.
#pragma once

namespace fltea {
namespace noise_models {

constexpr double kLn2 = 0.69314718055994530942;
constexpr double kHighestOrder = 1.999;
constexpr double kLogitEnd = 16;
constexpr double kHighestHighPass =
    // Largest log |1 - e^{-iλ}|² of a high-pass's corner frequency λ. It is that of a tenth of the sampling
    // rate. A high-pass with a higher corner looks like the noise part kRise.
    -0.96;
// largest logarithm of the ratio of a resonance's width to its frequency; a wider resonance has no visible
// maximum
constexpr double kWidestPeak = -1.0;

// The noise parts. The comments name the free parameters of each part after "parameters", in the order in
// which a fit has them; h is the sampling period, and logit p = log(p / (1 - p)). If two parts would raise
// the likelihood equally, a search prefers the one that comes first here.
enum Part : int {
    kWhite,  // white noise; parameter: log of its variance R
    // relaxation (first-order Gauss-Markov process); parameters: log of its variance σ², and log of the ratio
    // of h to its correlation time τ
    kRelaxation,
    kWalk,  // random walk; parameter: log of the variance of a step
    // fractional state D^α x = f x + ω of the order α, where the steps have the variance s2; parameters: α,
    // logit(-g / 2^α) with g = h^α f, and log s2
    kOrder,
    // resonance; parameters: log of the height of its peak, log of its frequency [rad per sample], and log of
    // the ratio of its width to its frequency
    kResonance,
    // differences of white noise, as from rounding; parameter: log of the variance of that white noise
    kQuantised,
    // noise whose power is proportional to |1 - e^{-iλ}|^2δ, and so rises with the frequency λ; two
    // parameters: the log of the power at λ = π, and δ
    kRise,
    // sampled low-pass with n poles and the analog gain 1 / (1 + (λ² / c)^n); parameters: log c, and n as a
    // logit between its limits
    kLowPass,
    // high-pass with n poles and the gain 1 / (1 + (c / |1 - e^{-iλ}|²)^n); parameters: log c, and n as a
    // logit between its limits
    kHighPass,
    // filter with the taps -s, 1 + 2 s, -s, which sharpens if s > 0 and smooths if s < 0; parameter: s
    kSharp,
    // notch; parameters: log of the frequency that it removes, and log of the ratio of its width to this
    // frequency
    kNotch,
    kMean,  // filter that takes the mean of m samples, with a fixed m; it has no parameter
    // relaxation in which every second sample has the opposite sign; parameters: as for kRelaxation
    kAlternating,
    // white noise that is added after all filters, for example by rounding; parameter: log of its variance
    kFloor,
    // noise with an order d but no f, ARFIMA(1, d, 0) with φ = e^-rate and steps of variance s2; parameters:
    // d, log of that rate, and log of s2 / (1 - φ)²
    kArfima,
    // the same noise as kOrder, with other parameters, so that a fit can hold F = g + α fixed; parameters: F,
    // log(-g), and log s2
    kOrderByF,
    // the same noise as kOrder, with other parameters, so that a fit can hold f = g / h^α fixed; parameters:
    // α, log(-f), and log s2
    kOrderByf,
    // the same noise as kOrder, with other parameters, so that a fit can hold Q = s2 / h^2α fixed;
    // parameters: α, logit(-g / 2^α), and log Q
    kOrderByQ,
    // the same noise as kArfima, with another third parameter, log s2, so that a fit can hold s2 fixed
    kArfimaByStep,
};
constexpr int kParts = kArfimaByStep + 1;

// Kinds of free parameters. The kind determines the bounds of a parameter (bounds_of). Where a comment does
// not say otherwise, the bounds follow from the data or are `low` and `high` in the part's row of the table.
enum Value : int {
    kLevel,      // log of the variance of white noise
    kPower,      // log of the power of a noise part
    kRate,       // log of h / τ, where h is the sampling period and τ the correlation time
    kPole,       // log of the rate of the part kArfima, whose coefficient φ is e^-rate
    kAlpha,      // an order, whose bounds are those of the fit
    kNumber,     // a parameter that is used as it is, without a transformation
    kShape,      // a logit or a logarithm; its bounds are where the spectrum hardly changes any more
    kFrequency,  // log of a frequency λ, at most log π + `high`
    kCorner,     // log λ², where λ is at least the data's lowest frequency, and log λ² at most `high`
    kMinusF,     // log(-f), where f is that of the part kOrderByf
    kNoise,      // log of Q, the variance that is a parameter of the part kOrderByQ
};

// The names that Python has for values of the enums. The compiler reports a value without a name
// (-Wswitch-enum).
inline const char* name_of(Value value) {
    switch (value) {
        case kLevel:
            return "level";
        case kPower:
            return "power";
        case kRate:
            return "rate";
        case kPole:
            return "pole";
        case kAlpha:
            return "alpha";
        case kNumber:
            return "number";
        case kShape:
            return "shape";
        case kFrequency:
            return "frequency";
        case kCorner:
            return "corner";
        case kMinusF:
            return "minus f";
        case kNoise:
            return "noise";
    }
    return "";
}

struct FreeParameter {
    Value value;
    double low, high;
};

struct FreeParameters {
    int count;
    FreeParameter at[3];

    constexpr FreeParameters() : count(0), at{{kNumber, 0, 0}, {kNumber, 0, 0}, {kNumber, 0, 0}} {}
    constexpr FreeParameters(FreeParameter a) : count(1), at{a, {kNumber, 0, 0}, {kNumber, 0, 0}} {}
    constexpr FreeParameters(FreeParameter a, FreeParameter b) : count(2), at{a, b, {kNumber, 0, 0}} {}
    constexpr FreeParameters(FreeParameter a, FreeParameter b, FreeParameter c) : count(3), at{a, b, c} {}
};

// Columns of the bins that only some noise parts need in order to compute their spectra (Columns in
// whittle_kernel.hpp).
enum Read : unsigned { kNoColumn = 0, kSquare = 1, kTurn = 2, kLogSize = 4, kBranch = 8, kAllColumns = 15 };

enum Trait : unsigned {
    kFilter = 1,  // a filter, which multiplies the spectrum of the parts before it
    kBehind = 2,  // noise that is added after all filters
    // noise with a memory; it is a state in the tracker's filter, and no part of the white noise N
    kSlow = 4,
    kOrdered = 8,  // noise with an order, which in a model takes the place of all other slow noise
    // random walk: no model has it together with a high-pass, because one pole of a high-pass makes it white
    // noise
    kNoHighPass = 16,
    kRising = 32,    // noise whose power may rise with the frequency
    kFastOnly = 64,  // noise without power at low frequencies
    // In files for navigation programs, this part has fields of its own. All other parts are only listed
    // there, with their parameters.
    kEntry = 128,
    kOther = 256,  // the same noise as another part, but with other free parameters; no search adds it
    // noise that can imitate several other parts, which have fewer parameters. If a search had added it, it
    // would not add those others any more. It is therefore added only in a separate search. The model of that
    // search is used only if it is better.
    kApart = 512,
};

inline const char* name_of(Trait trait) {
    switch (trait) {
        case kFilter:
            return "filter";
        case kBehind:
            return "behind";
        case kSlow:
            return "slow";
        case kOrdered:
            return "ordered";
        case kNoHighPass:
            return "no high-pass";
        case kRising:
            return "rising";
        case kFastOnly:
            return "fast only";
        case kEntry:
            return "entry";
        case kOther:
            return "other";
        case kApart:
            return "apart";
    }
    return "";
}

// Which question of the verdict a part answers in a model without an order. host/fltea/spectrum/answers.py
// has a row for each question. kNothing and kAnOrder are no such questions.
enum Says : int { kNothing, kRelaxations, kDrift, kAnOrder, kAResonance, kAColour, kANotch, kAHighPass };

inline const char* name_of(Says says) {
    switch (says) {
        case kNothing:
            return "nothing";
        case kRelaxations:
            return "relaxations";
        case kDrift:
            return "drift";
        case kAnOrder:
            return "order";
        case kAResonance:
            return "resonance";
        case kAColour:
            return "colour";
        case kANotch:
            return "notch";
        case kAHighPass:
            return "high-pass";
    }
    return "";
}

// At which values of its parameters a search tries a noise part (whittle_gains.hpp).
enum Start : int {
    kNever,
    kOnce,  // once, because the part's only parameter is its power, which the search computes
    // once for each of the values in Starts::at. They are values of the first parameter of a filter, or of
    // the second parameter of a noise, whose first is its power
    kListed,
    kCorners,
    kPeaks,
    kLowPasses,
    kHighPasses,
    kNotches,
    kMeans,
    kOrders,
    kArfimas,
};

struct Starts {
    Start start;
    int count;
    double at[3];

    constexpr Starts(Start from) : start(from), count(0), at{0, 0, 0} {}
    constexpr Starts(double a, double b) : start(kListed), count(2), at{a, b, 0} {}
    constexpr Starts(double a, double b, double c) : start(kListed), count(3), at{a, b, c} {}
};

struct Row {
    Part part;
    const char* name;  // name of this part in Python and in files
    unsigned traits;
    Says says;
    unsigned columns;
    int most;  // largest number of parts of this kind in a model
    // Additional number of parameters that the criterion BIC counts for this part, because a search tries
    // many values of them. An example is the number m of samples in a mean, which no fit changes.
    int sought;
    FreeParameters free_parameters;
    Starts starts;

    // Rows are made with a constructor, so that the compiler rejects a row in which a column is missing.
    constexpr Row(Part number, const char* called, unsigned is, Says tells, unsigned read, int at_most,
                  int tried, FreeParameters free, Starts from)
        : part(number),
          name(called),
          traits(is),
          says(tells),
          columns(read),
          most(at_most),
          sought(tried),
          free_parameters(free),
          starts(from) {}
    constexpr bool is(unsigned trait) const { return (traits & trait) != 0; }
};

constexpr FreeParameter kOfLevel{kLevel, 0, 0}, kOfPower{kPower, 0, 0}, kOfRate{kRate, 0, 0},
    kOfPole{kPole, 0, 0};
constexpr FreeParameter kOfOrder{kAlpha, 0, kHighestOrder}, kOfLogit{kShape, -kLogitEnd, kLogitEnd};
constexpr FreeParameter kOfD{kAlpha, 0, 1};

// clang-format off
constexpr Row kTable[] = {
    // The columns of a row, in the order in which they stand on its two lines:
    // part, name, traits,
    //     says, columns, most, sought, free_parameters, starts
    {kWhite, "white", kEntry,
        kNothing, kNoColumn, 1, 0, {kOfLevel}, {kNever}},
    {kRelaxation, "relaxation", kSlow | kEntry,
        kRelaxations, kSquare, 6, 0, {kOfPower, kOfRate}, {kCorners}},
    {kWalk, "walk", kSlow | kNoHighPass | kEntry,
        kDrift, kSquare, 1, 0, {kOfPower}, {kOnce}},
    {kOrder, "order", kSlow | kOrdered,
        kAnOrder, kLogSize, 1, 0, {kOfOrder, kOfLogit, kOfPower}, {kOrders}},
    {kResonance, "resonance", 0,
        kAResonance, kTurn, 2, 0, {kOfPower, {kFrequency, 0, 0}, {kShape, -9, kWidestPeak}}, {kPeaks}},
    {kQuantised, "quantisation", kRising | kFastOnly | kEntry,
        kAColour, kSquare, 1, 0, {kOfPower}, {kOnce}},
    {kRise, "rise", kRising | kFastOnly,
        kAColour, kLogSize, 1, 0, {kOfPower, {kNumber, 0.1, 2}}, {0.3, 0.6, 1.5}},
    {kLowPass, "low-pass", kFilter,
        kAColour, kBranch, 1, 0, {{kCorner, 0, 4.5}, kOfLogit}, {kLowPasses}},
    {kHighPass, "high-pass", kFilter,
        kAHighPass, kLogSize, 1, 0, {{kCorner, 0, kHighestHighPass}, kOfLogit}, {kHighPasses}},
    {kSharp, "sharpening", kFilter | kRising,
        kAColour, kSquare, 1, 0, {{kNumber, -0.2495, 2}}, {-0.05, 0.05}},
    {kNotch, "notch", kFilter,
        kANotch, kSquare, 1, 1, {{kFrequency, 0, -1e-3}, {kShape, -7, 1}}, {kNotches}},
    {kMean, "mean", kFilter,
        kAColour, kNoColumn, 1, 1, {}, {kMeans}},
    {kAlternating, "alternating", kRising,
        kAColour, kSquare, 1, 0, {kOfPower, kOfRate}, {-2.0, -0.7, 0.3}},
    {kFloor, "floor", kBehind,
        kNothing, kNoColumn, 1, 0, {kOfLevel}, {kOnce}},
    {kArfima, "arfima", kSlow | kOrdered,
        kAnOrder, kLogSize | kSquare, 1, 0, {kOfD, kOfPole, kOfPower}, {kArfimas}},
    {kOrderByF, "order by F", kSlow | kOrdered | kOther, kAnOrder, kLogSize, 1, 0,
        {{kNumber, -2, kHighestOrder}, {kShape, -kLogitEnd, 2 * kLn2}, kOfPower}, {kNever}},
    {kOrderByf, "order by f", kSlow | kOrdered | kOther, kAnOrder, kLogSize, 1, 0,
        {kOfOrder, {kMinusF, -kLogitEnd, 0}, kOfPower}, {kNever}},
    {kOrderByQ, "order by Q", kSlow | kOrdered | kOther, kAnOrder, kLogSize, 1, 0,
        {kOfOrder, kOfLogit, {kNoise, 0, 0}}, {kNever}},
    {kArfimaByStep, "arfima by s2", kSlow | kOrdered | kOther, kAnOrder, kLogSize | kSquare, 1, 0,
        {kOfD, kOfPole, kOfPower}, {kNever}},
};
// clang-format on

constexpr bool in_order(int i = 0) { return i == kParts || (kTable[i].part == i && in_order(i + 1)); }
static_assert(sizeof kTable == kParts * sizeof(Row), "each part of the enum Part has a row in kTable");
static_assert(in_order(), "the rows of kTable are in the order of the enum Part");

// Python's classes of parts have the numbers of the first rows (host/fltea/noise/parts.py).
constexpr bool others_last(int i = 1) {
    return i == kParts || ((kTable[i].is(kOther) || !kTable[i - 1].is(kOther)) && others_last(i + 1));
}
static_assert(others_last(), "the rows of kTable with the trait kOther come after all other rows");

inline const Row& row_of(Part part) { return kTable[part]; }
inline bool filters(Part part) { return row_of(part).is(kFilter); }
inline int free_of(Part part) { return row_of(part).free_parameters.count; }

// Returns the index of the free parameter that is the logarithm of a part's power, or -1 if there is none.
inline int power_of(Part part) {
    const FreeParameters& own = row_of(part).free_parameters;
    for (int k = 0; k < own.count; ++k)
        if (own.at[k].value == kLevel || own.at[k].value == kPower) return k;
    return -1;
}

}  // namespace noise_models
}  // namespace fltea
