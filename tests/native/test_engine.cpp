// Tests of the engine in C++: directly, as a device would run it (float or double, one lane), and through the
// table of functions that the Python binding uses. tests/estimator checks its numbers. The tests here check
// accesses to memory, undefined behaviour, and that the results are the same for every number type.
#include <doctest/doctest.h>

#include <cmath>
#include <cstring>
#include <vector>

#include "engine.hpp"
#include "lane.hpp"
#include "memory_compressed.hpp"
#include "memory_direct.hpp"
#include "noise.h"

using namespace fltea::engine;

namespace {

// The settings of section 7.1 of the paper.
const LaneSettings kGyroscope = {std::log(0.01), 0,   0.01, 0.15, 0.0235, 1,      0.01, 0.1,
                                 0.0235,         0.5, 0,    0.01, 0.1,    0.0235, 0.5,  4};
// The default settings of the joint filter.
const LaneSettings kJoint = {std::log(0.01), 0, 0.01, 0.15, 0.0235, 0.5,    0.06, 0,
                             0.1735,         0, -0.1, 0.06, 0,      0.1735, 0,    4};

template <class T>
Tuning<T> tuning_of(const LaneSettings& settings) {
    Tuning<T> tuning;
    const double* from = &settings.log_h;
    for (std::size_t i = 0; i < sizeof(LaneSettings) / sizeof(double); ++i) {
        reinterpret_cast<T*>(&tuning)[i] = T(Real<T>(from[i]));
    }
    return tuning;
}

template <class T>
struct Direct {
    typedef DirectMemory<T> Memory;
    static std::size_t storage() { return Memory::storage(40); }
    static Memory make(T* storage) { return Memory(storage, 40); }
};
template <class T>
struct Compressed {
    typedef CompressedMemory<T> Memory;
    static std::size_t storage() { return Memory::storage(compressed_config(40)); }
    static Memory make(T* storage) { return Memory(storage, compressed_config(40)); }
};

template <class T>
Sample<T> sample_of(double y, double u, bool missing) {
    const Sample<T> sample = {T(Real<T>(y)), T(Real<T>(u)), everywhere<T>(missing)};
    return sample;
}

// Returns all estimates of one lane (axis), sample after sample.
template <class T, template <class> class Variant, template <class> class Kind>
std::vector<double> run(Guard guard, const LaneSettings& settings, const std::vector<double>& y) {
    std::vector<T> storage(Kind<T>::storage());
    Lane<T, Variant<T>, typename Kind<T>::Memory> lane(Kind<T>::make(storage.data()), tuning_of<T>(settings),
                                                       guard);
    std::vector<double> result;
    for (std::size_t k = 0; k < y.size(); ++k) {
        Estimate<T> estimate;
        lane.step(sample_of<T>(y[k], k % 5 == 0 ? 0.1 : 0, k % 11 == 7), estimate);
        const T* numbers = &estimate.alpha;
        for (int i = 0; i < kColumns; ++i) result.push_back(static_cast<double>(get_lane(numbers[i], 0)));
    }
    return result;
}

bool same(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

std::vector<double> quiet(std::size_t n) {
    Noise noise;
    std::vector<double> y(n);
    for (std::size_t k = 0; k < n; ++k) y[k] = 0.15 * noise();
    return y;
}

// Returns samples, some of which no sensor should give: zeros, and values of a size up to `largest`.
std::vector<double> wild(std::size_t n, double largest) {
    Noise noise;
    std::vector<double> y = quiet(n);
    for (std::size_t k = 20; k < n; ++k) {
        if (k % 3 == 0) y[k] = (noise.next() < 0.5 ? -1 : 1) * std::pow(largest, 2 * noise.next() - 1);
        if (k > n / 2 && k < n / 2 + 20) y[k] = 0;
        if (k > n * 3 / 4) y[k] = largest;
    }
    return y;
}

template <template <class> class Variant, template <class> class Kind>
void one_source_one_answer(const LaneSettings& settings) {
    const std::vector<double> y = quiet(300);
    for (int guard = 0; guard < 3; ++guard) {
        const Guard mode = static_cast<Guard>(guard);
        const std::vector<double> wide = run<double, Variant, Kind>(mode, settings, y);
        const std::vector<double> pack = run<Pack<double, 2>, Variant, Kind>(mode, settings, y);
        const std::vector<double> narrow = run<float, Variant, Kind>(mode, settings, y);
        bool equal = true;
        double worst = 0;
        for (std::size_t i = 0; i < wide.size(); ++i) {
            equal = equal && same(wide[i], pack[i]);
            if (i % kColumns == kAlpha || i % kColumns == kX)
                worst = std::fmax(worst, std::fabs(wide[i] - narrow[i]));
        }
        CHECK(equal);
        CHECK(worst < 1e-3);
    }
}

template <class T, template <class> class Variant, template <class> class Kind>
void survives(const LaneSettings& settings, double largest) {
    const std::vector<double> y = wild(400, largest);
    for (int guard = 1; guard < 3; ++guard) {
        const std::vector<double> estimates = run<T, Variant, Kind>(static_cast<Guard>(guard), settings, y);
        bool good = true;
        for (std::size_t i = 0; i < estimates.size(); ++i) {
            good = good && (std::isfinite(estimates[i]) || i % kColumns == kInnovation);
            if (i % kColumns == kAlpha) good = good && estimates[i] >= 0 && estimates[i] <= 2;
        }
        CHECK(good);
    }
    // without the guard the filter may diverge, but must not crash
    run<T, Variant, Kind>(Guard::off, settings, y);
}

}  // namespace

TEST_CASE("float, double and a pack run the same filters") {
    one_source_one_answer<Triple, Direct>(kGyroscope);
    one_source_one_answer<Triple, Compressed>(kGyroscope);
    one_source_one_answer<Joint, Direct>(kJoint);
    one_source_one_answer<Joint, Compressed>(kJoint);
}

TEST_CASE("guarded lanes survive what squares can hold") {
    survives<double, Triple, Direct>(kGyroscope, 1e100);
    survives<double, Triple, Compressed>(kGyroscope, 1e100);
    survives<double, Joint, Direct>(kJoint, 1e100);
    survives<double, Joint, Compressed>(kJoint, 1e100);
    survives<float, Triple, Direct>(kGyroscope, 1e12);
    survives<float, Triple, Compressed>(kGyroscope, 1e12);
    survives<float, Joint, Direct>(kJoint, 1e12);
    survives<float, Joint, Compressed>(kJoint, 1e12);
}

TEST_CASE("a state is its numbers and nothing else") {
    typedef Lane<float, Triple<float>, DirectMemory<float>> Float;
    typedef Lane<double, Joint<double>, DirectMemory<double>> Double;
    CHECK(sizeof(Float::State) == (10 + kCauses) * sizeof(float));
    CHECK(sizeof(Double::State) == (12 + kCauses) * sizeof(double));
    CHECK(sizeof(Tuning<float>) * 2 == sizeof(LaneSettings));
}

TEST_CASE("a lane begins again while the memory of others goes on") {
    std::vector<double> storage(Direct<double>::storage());
    typedef Lane<double, Triple<double>, DirectMemory<double>> OneLane;
    OneLane lane(Direct<double>::make(storage.data()), tuning_of<double>(kGyroscope), Guard::off);
    Estimate<double> first, again;
    lane.step(sample_of<double>(0.3, 0, false), first);
    for (int k = 0; k < 70; ++k) lane.step(sample_of<double>(0.1 * k, 0, false), again);
    lane.reset(true);
    lane.step(sample_of<double>(0.3, 0, false), again);
    CHECK(std::memcmp(&first, &again, sizeof first) == 0);
}

TEST_CASE("the table runs any number of lanes, and what is loaded goes on like what was saved") {
    const Backend& backend = engine_baseline;
    for (std::size_t lanes = 1; lanes < 6; ++lanes) {
        for (int kind = 0; kind < 12; ++kind) {
            const EngineShape shape = {lanes, kind % 2, kind / 2 % 3, kind / 6, 0, 30};
            const std::vector<LaneSettings> settings(lanes, kind % 2 ? kJoint : kGyroscope);
            const std::size_t words = backend.storage(shape) / 64 + 2;
            struct alignas(64) Line {
                unsigned char bytes[64];
            };
            // C++11 aligns the memory of a std::vector to 16 bytes only, so its address is rounded up below
            std::vector<Line> raw_a(words), raw_b(words);
            const auto aligned = [](std::vector<Line>& raw) {
                const std::uintptr_t address = reinterpret_cast<std::uintptr_t>(raw.data());
                return reinterpret_cast<void*>((address + 63) / 64 * 64);
            };
            void *const a = aligned(raw_a), *const b = aligned(raw_b);
            backend.start(a, shape, settings.data());
            backend.start(b, shape, settings.data());

            const std::size_t n = 50;
            const std::vector<double> noise = quiet(n * lanes);
            std::vector<std::uint8_t> missing(n * lanes, 0);
            missing[n * lanes / 2] = 1;
            std::vector<double> first(kColumns * n * lanes), second(first), third(first);
            Block block = {n, noise.data(), noise.data(), missing.data(), {}};
            const auto into = [&](std::vector<double>& out) {
                for (int i = 0; i < kColumns; ++i)
                    block.out[i] = out.data() + static_cast<std::size_t>(i) * n * lanes;
            };
            into(first);
            backend.run(a, shape, block);
            std::vector<unsigned char> saved(backend.snapshot(shape));
            backend.save(a, shape, saved.data());
            CHECK(backend.load(b, shape, saved.data()));
            into(second);
            backend.run(a, shape, block);
            into(third);
            backend.run(b, shape, block);
            CHECK(std::memcmp(second.data(), third.data(), second.size() * sizeof(double)) == 0);
            CHECK(first != second);

            std::vector<std::int32_t> counts(lanes * static_cast<std::size_t>(backend.causes));
            backend.counts(a, shape, counts.data());
            const std::vector<std::uint8_t> everyone(lanes, 1);
            backend.reset(a, shape, everyone.data());
            backend.counts(a, shape, counts.data());
            CHECK(counts == std::vector<std::int32_t>(counts.size(), 0));
        }
    }
}
