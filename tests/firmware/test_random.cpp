// Tests with thousands of random disturbances, made from fixed seeds of the random numbers. The same rules
// have to be true for all disturbances.
#include <doctest/doctest.h>

#include <random>

#include "rig.h"

using fltea::HeldLines;
using fltea::I2cResult;
using fltea::SamplingMode;

namespace {

// Causes a fault every half second on average, until end() is called.
class Trouble {
  public:
    Trouble(Rig& rig, uint32_t seed) : rig_(rig), random_(seed), next_us_(rig.clock.us()) {}

    void maybe() {
        const uint64_t now = rig_.clock.us();
        if (!rig_.bus.plugged && now > unplugged_until_us_) plug_in();
        if (now > jammed_until_us_) rig_.sink.jammed = false;
        if (now > quiet_until_us_) rig_.chip.quiet = false;
        if (now > errors_until_us_) rig_.bus.script.clear();
        if (now > stopped_until_us_) rig_.chip.stopped = false;
        if (now > held_until_us_) rig_.bus.held = HeldLines::none;
        if (over_ || now < next_us_) return;
        next_us_ = now + below(kS);
        errors_until_us_ = now + 100 * kMs;
        switch (below(12)) {
            case 0:
            case 1:
                return rig_.bus.fail(I2cResult::nack, 1 + below(12));
            case 2:
                return rig_.bus.fail(I2cResult::timeout, 1 + below(5));
            case 3:
                return rig_.bus.fail(I2cResult::short_read, 1 + below(5));
            case 4:
                return rig_.chip.power_up();
            case 5:
                rig_.bus.plugged = false;
                unplugged_until_us_ = now + below(2 * kS);
                return;
            case 6:
                rig_.bus.held = static_cast<HeldLines>(1 + below(3));
                rig_.bus.clocks_to_free = static_cast<int>(below(4)) - 1;
                held_until_us_ = now + below(kS / 5);
                return;
            case 7:
                rig_.bus.flip_reg = 0x19;
                rig_.bus.flips = static_cast<int>(1 + below(7));
                return;
            case 8:
                rig_.bus.stale = true;
                return;
            case 9:
                rig_.chip.stopped = true;
                stopped_until_us_ = now + below(kS / 5);
                return;
            case 10:
                rig_.sink.jammed = true;
                jammed_until_us_ = now + below(kS / 2);
                return;
            default:
                if (below(2) == 0) {
                    rig_.chip.quiet = true;
                    quiet_until_us_ = now + below(kS / 5);
                }
                return rig_.clock.pass(below(60) * kMs);
        }
    }

    void end() {
        over_ = true;
        errors_until_us_ = unplugged_until_us_ = jammed_until_us_ = quiet_until_us_ = held_until_us_ = 0;
        stopped_until_us_ = 0;
    }

  private:
    uint32_t below(uint64_t n) { return static_cast<uint32_t>(random_() % n); }
    void plug_in() {
        rig_.bus.plugged = true;
        rig_.chip.power_up();
    }

    Rig& rig_;
    std::mt19937 random_;
    uint64_t next_us_;
    uint64_t errors_until_us_ = 0;
    uint64_t unplugged_until_us_ = 0;
    uint64_t jammed_until_us_ = 0;
    uint64_t quiet_until_us_ = 0;
    uint64_t held_until_us_ = 0;
    uint64_t stopped_until_us_ = 0;
    bool over_ = false;
};

// Checks all frames that the device sent, one after the other.
void check_all_that_was_sent(const Rig& rig, SamplingMode mode) {
    std::map<int, uint16_t> next;
    std::map<int, uint64_t> last_fault_us;
    bool sampled = false;
    int16_t life = 0;
    uint16_t starts = 0;
    uint16_t starts_of_life = 0;
    uint64_t number = 0;
    uint64_t first_us = 0;
    uint64_t us = rig.clock.us() - rig.clock.run_us();
    uint32_t stamp = static_cast<uint32_t>(us);
    for (const Frame& frame : rig.sink.receiver.frames) {
        // In timer mode, a frame has the time at which it was made, so times never go back. In data-ready
        // mode, a sample has the time of its edge, which may be earlier than the time of the frame before.
        if (mode == SamplingMode::timer) REQUIRE(frame.device_us - stamp < 0x80000000u);
        stamp = frame.device_us;
        if (frame.type != fltea::Sample::type()) REQUIRE(frame.sequence == next[frame.type]++);
        if (frame.type == fltea::Hello::type()) starts = message_of<fltea::Hello>(frame).sensor_starts;
        if (frame.type == fltea::Fault::type()) {
            uint64_t at = us + static_cast<uint32_t>(frame.device_us - static_cast<uint32_t>(us));
            uint64_t& last = last_fault_us[static_cast<int>(message_of<fltea::Fault>(frame).code)];
            if (last != 0) REQUIRE(at - last >= kS);
            last = at;
        }
        if (frame.type != fltea::Sample::type()) continue;

        const fltea::Sample sample = message_of<fltea::Sample>(frame);
        us += static_cast<uint32_t>(frame.device_us - static_cast<uint32_t>(us));
        REQUIRE(sample.gyro_x != kWrong);
        REQUIRE(starts > 0);
        // `life` counts resets of the chip. If it has changed since the last sample, a HELLO has come between
        // the two samples, with another count of starts of the sensor.
        if (sample.accel_x != life) REQUIRE(starts != starts_of_life);
        life = sample.accel_x;
        starts_of_life = starts;

        if (!sampled) first_us = us - frame.sequence * kPeriodUs;
        const uint16_t step = static_cast<uint16_t>(frame.sequence - static_cast<uint16_t>(number));
        if (sampled) REQUIRE(step > 0);
        number = sampled ? number + step : frame.sequence;
        sampled = true;
        // A sample was due at a time that its sequence number tells. It may be late by a sampling period and
        // one chain of failed transfers. It may seem early by as much: times are compared with that of the
        // first sample, which may itself have been late.
        const double late_us = static_cast<double>(us - first_us) - static_cast<double>(number) * 10000.0;
        const double bound_us = mode == SamplingMode::timer ? 20000 : 30000;
        REQUIRE(late_us < bound_us);
        REQUIRE(late_us > -bound_us);
    }
    REQUIRE(sampled);
    const fltea::Status status = rig.status();
    const std::vector<Frame> samples = rig.samples();
    REQUIRE(number + 1 == samples.size() + status.overruns + status.dropped_frames);
    // A wrong answer of the chip counts as an error only if the chip gives the right answer when asked again.
    // So the expected count is known only to lie between two limits.
    REQUIRE(status.i2c_errors >= static_cast<uint32_t>(rig.bus.failures));
    REQUIRE(status.i2c_errors <= static_cast<uint32_t>(rig.bus.failures + rig.bus.wrong_reads));
}

}  // namespace

TEST_CASE("random trouble: nothing is sent that must not be, and delivered + overruns + dropped = due") {
    size_t sent = 0;
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        for (uint32_t seed = 0; seed < 30; ++seed) {
            CAPTURE(seed);
            CAPTURE(int(mode));
            Rig rig(mode, seed % 2 == 0 ? 0 : kWrap - 10 * kS);
            rig.calls = static_cast<Rig::Calls>(seed % 3);
            Trouble trouble(rig, seed);
            rig.before_step = [&] { trouble.maybe(); };
            rig.start();
            rig.run(20 * kS);
            trouble.end();
            // from now on, step() is called at every tick: no sample may be missed after the last STATUS,
            // which counts the missed samples
            rig.calls = Rig::Calls::every_tick;
            rig.run(4 * kS);
            check_all_that_was_sent(rig, mode);
            sent += rig.samples().size();
            REQUIRE(rig.sink.receiver.judged() == rig.sink.receiver.counts["frames"]);
        }
    }
    // 60 runs of 24 s have 144,000 sampling instants; despite the faults, at least 40,000 gave samples
    CHECK(sent > 40000);
}
