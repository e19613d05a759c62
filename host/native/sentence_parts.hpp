// The parts of which a noise is made, in one table. Search, fit and intervals take from it what they have to
// know of a part, and so does Python (host/fltea/noise/part.py).
//
// A new part is a number in Part and a row in kTable here, its spectrum in sentence_kernel.cpp, and a class
// in host/fltea/noise/parts.py. Compilers and tests name what is missing (tests/noise/test_part_table.py).
#pragma once

namespace fltea {
namespace sentence {

constexpr double kLn2 = 0.69314718055994530942;
constexpr double kHighestOrder = 1.999;
constexpr double kLogitEnd = 16;
constexpr double kHighestHighPass =
    -0.96;                            // log c of a corner at a tenth of the sample rate: above is a rise
constexpr double kWidestPeak = -1.0;  // what is wider has no maximum to be seen

// The comments name the coordinates, in the order in which a fit has them. A search ranks what gains the same
// in the order of the numbers.
enum Part : int {
    kWhite,         // log R
    kRelaxation,    // log σ², log h/τ
    kWalk,          // log of the variance of a step
    kOrder,         // α, logit(-g / 2^α), log s2
    kResonance,     // log of the height, log of the frequency in rad a sample, log of width over frequency
    kQuantised,     // log of the variance of the noise whose differences these are
    kRise,          // log of the power at π, δ: the power goes with |1 - e^{-iλ}|^2δ
    kLowPass,       // log c, logit of the poles: 1 / (1 + (λ² / c)^n), sampled
    kHighPass,      // log c, logit of the poles: 1 / (1 + (c / |1 - e^{-iλ}|²)^n)
    kSharp,         // s: the filter -s, 1 + 2 s, -s, which sharpens, or smooths if s < 0
    kNotch,         // log of the frequency, log of width over frequency
    kMean,          // the mean of m samples, m fixed
    kAlternating,   // log σ², log h/τ: as a relaxation, of which every second sample has its sign changed
    kFloor,         // log of the variance of white noise that no filter has changed: rounding
    kArfima,        // d, log rate, log s2: an order without f, ARFIMA(1, d, 0), φ = e^-rate
    kOrderByF,      // F = g + α, log -g, log s2: the same as kOrder, to hold F
    kOrderByf,      // α, log -f, log s2: the same, to hold f (or g, with h = 1)
    kOrderByQ,      // α, logit(-g / 2^α), log Q: the same, to hold Q
    kArfimaByStep,  // d, log rate, log of the variance of a step: the same as kArfima, to hold that variance
};
constexpr int kParts = kArfimaByStep + 1;

// What a coordinate is, from which its bounds follow (bounds_of). Where no others are said they are from
// `low` to `high` of its row.
enum Value : int {
    kLevel,      // log of the variance of white noise
    kPower,      // log of a power
    kRate,       // log of h/τ
    kPole,       // the same of φ of ARFIMA
    kAlpha,      // an order, as far as the fit allows
    kNumber,     // the parameter itself
    kShape,      // a function of the parameter, beyond whose bounds all looks the same
    kFrequency,  // log of λ, `high` above π at most
    kCorner,     // log of λ², `high` at most
    kMinusF,     // log of -f
    kNoise,      // log of Q of an order
};
constexpr const char* kValueNames[] = {"level", "power",     "rate",   "pole",    "alpha", "number",
                                       "shape", "frequency", "corner", "minus f", "noise"};

struct Coordinate {
    Value value;
    double low, high;
};

struct Coordinates {
    int count;
    Coordinate at[3];

    constexpr Coordinates() : count(0), at{{kNumber, 0, 0}, {kNumber, 0, 0}, {kNumber, 0, 0}} {}
    constexpr Coordinates(Coordinate a) : count(1), at{a, {kNumber, 0, 0}, {kNumber, 0, 0}} {}
    constexpr Coordinates(Coordinate a, Coordinate b) : count(2), at{a, b, {kNumber, 0, 0}} {}
    constexpr Coordinates(Coordinate a, Coordinate b, Coordinate c) : count(3), at{a, b, c} {}
};

// Columns of the bins that only some parts read.
enum Read : unsigned { kNoColumn = 0, kSquare = 1, kTurn = 2, kLogSize = 4, kBranch = 8, kAllColumns = 15 };

enum Trait : unsigned {
    kFilter = 1,     // it multiplies what comes before it
    kBehind = 2,     // it is added behind the filters
    kSlow = 4,       // it has a memory: a tracker's state has it, and N has nothing of it
    kOrdered = 8,    // an order, with all its slow power
    kEndless = 16,   // a walk, whose power grows without end at low frequencies
    kRising = 32,    // it lets the power rise with frequency
    kFastOnly = 64,  // it has no power at low frequencies
    kEntry = 128,  // a navigation file has an entry for it; all others are listed there with their parameters
    kOther = 256,  // another part by other coordinates, which no search adds
};
constexpr const char* kTraitNames[] = {"filter", "behind",    "slow",  "ordered", "endless",
                                       "rising", "fast only", "entry", "other"};

// To which question of the verdict a part is the answer, if there is no order
// (host/fltea/spectrum/reading.py).
enum Says : int { kNothing, kRelaxations, kDrift, kAnOrder, kAResonance, kAColour, kANotch, kAHighPass };
constexpr const char* kSaysNames[] = {"nothing",   "relaxations", "drift", "order",
                                      "resonance", "colour",      "notch", "high-pass"};

// Where a search tries a part (sentence_gains.hpp).
enum Start : int {
    kNever,
    kOnce,    // it has no coordinate but its power
    kListed,  // at these values of the coordinate after the power, or of a filter's first
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
    const char* name;  // in Python, and in files
    unsigned traits;
    Says says;
    unsigned columns;
    int most;    // of one model
    int sought;  // parameters that BIC counts beside the coordinates, since a search has tried many values
    Coordinates coordinates;
    Starts starts;

    // So that no column can be left out.
    constexpr Row(Part number, const char* called, unsigned is, Says tells, unsigned read, int at_most,
                  int tried, Coordinates free, Starts from)
        : part(number),
          name(called),
          traits(is),
          says(tells),
          columns(read),
          most(at_most),
          sought(tried),
          coordinates(free),
          starts(from) {}
    constexpr bool is(unsigned trait) const { return (traits & trait) != 0; }
};

constexpr Coordinate kOfLevel{kLevel, 0, 0}, kOfPower{kPower, 0, 0}, kOfRate{kRate, 0, 0},
    kOfPole{kPole, 0, 0};
constexpr Coordinate kOfOrder{kAlpha, 0, kHighestOrder}, kOfLogit{kShape, -kLogitEnd, kLogitEnd};
constexpr Coordinate kOfD{kAlpha, 0, 1};

// clang-format off
constexpr Row kTable[] = {
    // part, name, traits,
    //     says, columns, most, sought, coordinates, starts
    {kWhite, "white", kEntry,
        kNothing, kNoColumn, 1, 0, {kOfLevel}, {kNever}},
    {kRelaxation, "relaxation", kSlow | kEntry,
        kRelaxations, kSquare, 6, 0, {kOfPower, kOfRate}, {kCorners}},
    {kWalk, "walk", kSlow | kEndless | kEntry,
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

inline const Row& row_of(Part part) { return kTable[part]; }
inline bool filters(Part part) { return row_of(part).is(kFilter); }
inline int free_of(Part part) { return row_of(part).coordinates.count; }

// Which coordinate of a part is the logarithm of its power; -1: it has none.
inline int power_of(Part part) {
    const Coordinates& own = row_of(part).coordinates;
    for (int k = 0; k < own.count; ++k)
        if (own.at[k].value == kLevel || own.at[k].value == kPower) return k;
    return -1;
}

}  // namespace sentence
}  // namespace fltea
