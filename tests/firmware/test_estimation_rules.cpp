// Tests of the small rules of the device's estimates: the start-up window, the supervisor of the filters, and
// the percentage of time in which the device works.
#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "engine/baseline.hpp"
#include "engine/supervisor.hpp"
#include "moments.h"
#include "workload.h"

typedef fltea::engine::Baseline<int16_t> Baseline;
typedef fltea::engine::Supervisor<float> Supervisor;

namespace {

// Returns a pseudo-random number from 0 up to but not including `end`. The numbers are the same in each run
// of the test.
class Random {
  public:
    uint32_t operator()(uint32_t end) {
        state_ = state_ * 6364136223846793005u + 1442695040888963407u;
        return static_cast<uint32_t>(state_ >> 33) % end;
    }

  private:
    uint64_t state_ = 7;
};

Baseline baseline_of(const std::vector<int16_t>& counts) {
    Baseline baseline;
    for (int16_t count : counts) baseline.add(count);
    return baseline;
}

}  // namespace

TEST_CASE("baseline: mean and variance are those of two passes in double") {
    Random random;
    for (uint32_t n : {2u, 3u, 10u, 500u, 4096u}) {
        for (uint32_t width : {2u, 7u, 300u, 65536u}) {
            for (int offset : {-32768, -17, 0, 32768 - static_cast<int>(width)}) {
                std::vector<int16_t> counts;
                for (uint32_t i = 0; i < n; ++i) {
                    counts.push_back(static_cast<int16_t>(
                        std::min(32767, offset + static_cast<int>(i < 2 ? i : random(width)))));
                }
                const Baseline baseline = baseline_of(counts);
                const Moments expected = in_two_passes(counts);
                CAPTURE(n);
                CAPTURE(width);
                CAPTURE(offset);
                CHECK(baseline.samples() == n);
                CHECK(!baseline.constant());
                CHECK(baseline.bias() == static_cast<float>(expected.mean));
                CHECK(static_cast<double>(baseline.variance()) ==
                      doctest::Approx(std::max(expected.variance, 1.0 / 12)).epsilon(2e-7));
                for (int count : {-32768, 0, 32767}) {
                    const double left = static_cast<double>(baseline.centred(static_cast<int16_t>(count)));
                    CHECK(std::fabs(left - (count - expected.mean)) <= 6e-8 * std::fabs(left) + 1e-12);
                }
            }
        }
    }
}

TEST_CASE("baseline: both ends of the scale, in the longest window") {
    std::vector<int16_t> counts;
    for (int i = 0; i < 4096; ++i) counts.push_back(i % 2 == 0 ? INT16_MIN : INT16_MAX);
    const Baseline baseline = baseline_of(counts);
    CHECK(baseline.bias() == -0.5f);
    CHECK(static_cast<double>(baseline.variance()) ==
          doctest::Approx(in_two_passes(counts).variance).epsilon(2e-7));
    CHECK(baseline.centred(INT16_MAX) == 32767.5f);
}

TEST_CASE(
    "baseline: an axis that never changes is constant, one that changed once is as quiet as its counts") {
    for (int count : {-32768, 0, -7, 32767}) {
        CHECK(baseline_of(std::vector<int16_t>(4096, static_cast<int16_t>(count))).constant());
        CHECK(baseline_of(std::vector<int16_t>(4096, static_cast<int16_t>(count))).bias() ==
              static_cast<float>(count));
    }
    std::vector<int16_t> counts(500, -7);
    counts[499] = -6;
    CHECK(!baseline_of(counts).constant());
    CHECK(baseline_of(counts).variance() == 1.0f / 12.0f);
    // Now 46 of the 500 samples are larger by 1 than the others, so the variance is 0.0837. With 45 of them,
    // it would be below the lower limit of 1/12, which is the variance of rounding.
    for (size_t i = 0; i < 46; ++i) counts[i] = -6;
    CHECK(baseline_of(counts).variance() > 1.0f / 12.0f);
}

TEST_CASE("supervisor: more than 50 of the last 200 held withdraw an axis, 25 or less bring it back again") {
    Random random;
    int restarts = 0, withdrawn = 0;
    for (int run = 0; run < 40; ++run) {
        Supervisor supervisor;
        std::vector<bool> held;
        bool distrusted = false;
        for (int k = 0; k < 1500; ++k) {
            // For a while, the guard limits the state at many samples, and then at few. So the number of
            // limited samples among the last 200 passes slowly through both limits of the supervisor's rule,
            // 50 and 25.
            held.push_back(random(1000) < static_cast<uint32_t>(250 + 250 * std::sin(0.01 * k + run)));
            const size_t first = held.size() > 200 ? held.size() - 200 : 0;
            const long count = std::count(held.begin() + static_cast<long>(first), held.end(), true);
            const bool was = distrusted;
            distrusted = was ? count > 25 : count > 50;
            const Supervisor::Verdict verdict = supervisor.judge(1.0f, 0.0f, 0.0f, held.back());
            REQUIRE(verdict.valid == (!was && !distrusted));
            REQUIRE(verdict.restart == (was && !distrusted));
            withdrawn += !was && distrusted;
            if (!verdict.restart) continue;
            supervisor = Supervisor();
            held.clear();
            ++restarts;
        }
    }
    CHECK(withdrawn > 40);
    CHECK(restarts > 40);
}

TEST_CASE("supervisor: exactly 50 of 200 are borne, the 51st is not") {
    Supervisor supervisor;
    for (int k = 0; k < 50; ++k) CHECK(supervisor.judge(1.0f, 0.0f, 0.0f, true).valid);
    CHECK(!supervisor.judge(1.0f, 0.0f, 0.0f, true).valid);
}

TEST_CASE("supervisor: what is not finite, or an order beyond 5, ends an axis at once") {
    const float nan = std::nanf(""), infinite = std::numeric_limits<float>::infinity();
    const float lost[][3] = {{nan, 0, 0},       {5.001f, 0, 0}, {-5.001f, 0, 0},
                             {infinite, 0, 0},  {0, nan, 0},    {0, infinite, 0},
                             {0, -infinite, 0}, {0, 0, nan},    {0, 0, -infinite}};
    for (const auto& estimate : lost) {
        const Supervisor::Verdict verdict = Supervisor().judge(estimate[0], estimate[1], estimate[2], false);
        CHECK(!verdict.valid);
        CHECK(verdict.restart);
    }
    for (float alpha : {-5.0f, 5.0f}) CHECK(Supervisor().judge(alpha, 1e30f, -1e30f, false).valid);
}

TEST_CASE("workload: the share of the time that was worked, and the longest turn") {
    for (uint32_t start : {0u, UINT32_MAX - 300000u}) {  // the second start is 0.3 s before the clock wraps
        fltea::Workload workload;
        workload.begin(start);
        CHECK(int(workload.share(start)) == 0);
        workload.add(20000);
        workload.add(7);
        workload.add(230000);
        CHECK(int(workload.share(start + 1000000)) == 2500);
        CHECK(int(workload.share(start + 500000)) == 5000);
        CHECK(int(workload.share(start + 9999)) == 0);        // less than 10 ms is too short for a percentage
        CHECK(int(workload.share(start + 100000)) == 10000);  // the result is never more than 100 %
        CHECK(workload.longest_us() == 230000);
        workload.begin(start + 1000000);
        CHECK(int(workload.share(start + 2000000)) == 0);
        CHECK(workload.longest_us() == 0);
    }
}
