// Tests of the device while it computes estimates: what it sends and when, and what happens to samples if
// estimating is too slow.
#include <doctest/doctest.h>

#include "rig.h"

using fltea::Estimate;
using fltea::Estimator;
using fltea::SamplingMode;
namespace settings = fltea::settings;

namespace {

// This function, unless it is null, is called before every step of an axis.
std::function<void()> before_axis;

}  // namespace

// The linker replaces AxisEstimator::step by this function (Makefile).
extern "C" void __real__ZN5fltea13AxisEstimator4stepEPKs(fltea::AxisEstimator*, const int16_t*);
extern "C" void __wrap__ZN5fltea13AxisEstimator4stepEPKs(fltea::AxisEstimator* axis, const int16_t* count) {
    if (before_axis) before_axis();
    __real__ZN5fltea13AxisEstimator4stepEPKs(axis, count);
}

namespace {

// A simulated device at rest, with a few counts of noise on each axis. Each step of an axis's estimator takes
// the time `axis_us`.
struct Estimating : Rig {
    uint64_t axis_us = 1800;

    explicit Estimating(SamplingMode mode = SamplingMode::timer) : Rig(mode) {
        bus.tamper = [this](uint8_t reg, uint8_t* data) {
            if (reg != 0x3B) return;
            for (size_t i = 8; i < 14; i += 2) {
                random_ = random_ * 6364136223846793005u + 1442695040888963407u;
                data[i] = 0;
                data[i + 1] = static_cast<uint8_t>(random_ >> 60);
            }
        };
        before_axis = [this] { pass(axis_us); };
    }
    ~Estimating() { before_axis = nullptr; }

    // Simulates work of this duration, during which edges may come.
    void pass(uint64_t us) {
        const uint64_t end = clock.us() + us;
        while (clock.us() < end) {
            clock.pass(50);
            edges();
        }
    }

    std::vector<Frame> estimates() const { return sink.of<Estimate>(); }
    std::vector<Frame> estimators() const { return sink.of<Estimator>(); }
    Estimator estimator() const { return message_of<Estimator>(estimators().back()); }

  private:
    uint64_t random_ = 5;
};

Estimate estimate_of(const Frame& frame) { return message_of<Estimate>(frame); }

// Checks that the samples' numbers have no gap and that samples were read on time.
void check_every_sample(const Rig& rig, size_t from = 0) {
    const std::vector<Frame> samples = rig.samples();
    for (size_t i = from; i < samples.size(); ++i) {
        REQUIRE(samples[i].sequence == i);
        REQUIRE((message_of<fltea::Sample>(samples[i]).flags & fltea::sample_flags::late) == 0);
    }
    CHECK(rig.status().overruns == 0);
    CHECK(rig.status().dropped_frames == 0);
}

}  // namespace

TEST_CASE("estimating: every ESTIMATE comes after its SAMPLE, three by three, and no sample waits for one") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        for (size_t ring : {127u, 511u}) {
            CAPTURE(ring);
            Estimating rig(mode);
            rig.sink.size = ring;
            rig.start();
            rig.run(9 * kS);
            check_every_sample(rig);
            const std::vector<Frame>& frames = rig.sink.receiver.frames;
            uint16_t newest = 0;
            uint32_t n = 0;
            for (const Frame& frame : frames) {
                if (frame.type == fltea::Sample::type()) newest = frame.sequence;
                if (frame.type != Estimate::type()) continue;
                const Estimate estimate = estimate_of(frame);
                const uint32_t expected = settings::kStartup + n / 3 * settings::kEstimateEvery;
                CHECK(frame.sequence == n);
                CHECK(static_cast<uint32_t>(estimate.axis) == n % 3);
                CHECK(estimate.sample == expected);
                CHECK(estimate.age == expected - settings::kStartup + 1);
                CHECK(int(estimate.flags) == int(fltea::estimate_flags::valid));
                CHECK(newest >= estimate.sample);
                CHECK(newest <= estimate.sample + 2);
                ++n;
            }
            CHECK(n >= 3 * 35);
            CHECK(rig.estimator().longest_axis >= 1800);
            CHECK(rig.estimator().longest_axis < 1900);
            CHECK(rig.estimator().skipped == 0);
        }
    }
}

TEST_CASE("estimating: ESTIMATOR follows each HELLO, and comes when the window is full") {
    Estimating rig;
    rig.start();
    rig.run(8 * kS);
    size_t hellos = 0, estimators = 0;
    bool announced = false;
    uint16_t newest = 0;
    for (const Frame& frame : rig.sink.receiver.frames) {
        if (frame.type == fltea::Sample::type()) {
            newest = frame.sequence;
            // A ring buffer of 127 bytes cannot hold HELLO and ESTIMATOR at once, so ESTIMATOR may have to
            // wait during the first second.
            if (newest > 100 && newest % 100 == 60) CHECK(hellos <= estimators);
        }
        if (frame.type == fltea::Hello::type()) ++hellos;
        if (frame.type != Estimator::type()) continue;
        ++estimators;
        const Estimator message = message_of<Estimator>(frame);
        CHECK(message.begun <= 1);
        if (!announced && message.remaining == 0) {
            announced = true;
            CHECK(newest <= settings::kStartup + 1);
            CHECK(message.bias_x > 0);
            CHECK(message.r_x > 0);
        }
    }
    CHECK(announced);
    CHECK(estimators >= hellos);
    CHECK(estimators <= hellos + 1);
}

TEST_CASE(
    "estimating: too slow for its samples, it skips and says so, and every sample still comes on time") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        for (uint64_t axis_us : {3400, 4900}) {
            CAPTURE(axis_us);
            Estimating rig(mode);
            rig.axis_us = axis_us;
            rig.start();
            rig.run(20 * kS);
            check_every_sample(rig);
            const Estimator last = rig.estimator();
            CHECK(last.skipped > 100);
            CHECK(last.longest_axis >= axis_us);
            CHECK(last.begun == 1);
            const Estimate estimate = estimate_of(rig.estimates().back());
            CHECK((estimate.flags & fltea::estimate_flags::skipped) != 0);
            CHECK(estimate.age < estimate.sample - settings::kStartup + 1u);
            // Samples are skipped, so that the estimates do not fall behind without limit. The newest
            // ESTIMATE is behind the newest sample by a full queue (32 samples) and the samples between two
            // ESTIMATEs. The test allows three times that many.
            const int behind = int(rig.samples().back().sequence) - int(estimate.sample);
            CHECK(behind <= 3 * 32 + 3 * settings::kEstimateEvery);
            CHECK(int(rig.status().cpu_share) > 5000);
        }
    }
}

TEST_CASE(
    "estimating: a step of an axis slower than half a period is given that half, and costs no instant") {
    Estimating rig;
    rig.sink.size = 511;
    rig.axis_us = 8000;
    rig.start();
    rig.run(12 * kS);
    const std::vector<Frame> samples = rig.samples();
    for (size_t i = 0; i < samples.size(); ++i) REQUIRE(samples[i].sequence == i);
    CHECK(rig.status().overruns == 0);
    CHECK(rig.estimator().skipped > 100);
    CHECK(!rig.estimates().empty());
}

TEST_CASE("estimating: a sensor that has to be set up again is estimated again") {
    Estimating rig;
    rig.start();
    rig.run(7 * kS);
    const size_t before = rig.estimates().size();
    REQUIRE(before > 0);
    CHECK(rig.estimator().begun == 1);
    const uint32_t last = rig.samples().back().sequence;
    rig.bus.plugged = false;
    rig.run(100 * kMs);
    rig.bus.plugged = true;
    rig.run(8 * kS);
    CHECK(rig.hello().sensor_starts == 2);
    CHECK(rig.estimator().begun == 2);
    CHECK(rig.estimator().remaining == 0);
    const std::vector<Frame> estimates = rig.estimates();
    size_t after = before;
    while (estimate_of(estimates[after]).sample <= last) ++after;
    const Estimate first = estimate_of(estimates[after]);
    CHECK(first.sample > last + settings::kStartup);
    CHECK(first.age <= settings::kEstimateEvery);
}

TEST_CASE("estimating: STATUS says how much of the time is worked, and its longest turn") {
    for (uint64_t axis_us : {200u, 1000u, 2000u}) {
        CAPTURE(axis_us);
        Estimating rig;
        rig.sink.size = 511;
        rig.axis_us = axis_us;
        rig.start();
        rig.run(4 * kS);
        const fltea::Status window = rig.status();
        rig.run(4 * kS);
        const fltea::Status status = rig.status();
        // In the start-up window, only the bursts take time: 17 bytes of 22.5 us in every 10 ms. After the
        // window, one step of the estimator on each of three axes is added.
        CHECK(static_cast<double>(window.cpu_share) == doctest::Approx(383 + 30).epsilon(0.3));
        CHECK(static_cast<double>(status.cpu_share - window.cpu_share) ==
              doctest::Approx(static_cast<double>(3 * axis_us)).epsilon(0.05));
        CHECK(status.longest_step >= std::max(axis_us, uint64_t(383)));
        CHECK(status.longest_step < axis_us + 900);
    }
}
