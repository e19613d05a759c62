// A simulated device: the real application on fake hardware. The rig calls the application's step() as the
// code of a real board does.
#pragma once

#include <doctest/doctest.h>

#include <functional>

#include "application.h"
#include "fakes.h"

constexpr uint64_t kMs = 1000;
constexpr uint64_t kS = 1000000;
constexpr uint64_t kWrap = UINT64_C(1) << 32;  // time after which the 32-bit clock wraps [us]
constexpr uint64_t kPeriodUs = fltea::settings::kSamplePeriodUs;

inline fltea::Identity test_identity() {
    fltea::Identity identity = {0xB007B007, {}, "due", fltea::ResetCause::user};
    for (uint8_t i = 0; i < 16; ++i) identity.device_id[i] = static_cast<uint8_t>(0xA0 + i);
    return identity;
}

class Rig {
  public:
    // When the rig calls the application's step().
    enum class Calls { often, every_tick, unevenly };

    FakeClock clock;
    FakeChip chip;
    FakeBus bus;
    FakeSink sink;
    fltea::Application application;
    Calls calls = Calls::often;
    uint64_t edge_period_us = kPeriodUs;
    std::function<void()> before_step;

    explicit Rig(fltea::SamplingMode mode = fltea::SamplingMode::timer, uint64_t start_us = 0)
        : clock(start_us),
          chip(clock),
          bus(clock, chip),
          sink(clock),
          application(bus, sink, clock, test_identity(), mode),
          next_edge_us_(start_us) {
        if (mode == fltea::SamplingMode::data_ready) chip.wanted[0] = 9;
        bus.during = [](void* self) { static_cast<Rig*>(self)->edges(); };
        bus.during_of = this;
    }

    // Runs the device for `us` more microseconds.
    void run(uint64_t us) {
        const uint64_t end = clock.us() + us;
        while (clock.us() < end) {
            if (before_step) before_step();
            edges();
            const uint64_t begun = clock.us();
            application.step();
            REQUIRE(clock.us() - begun <= 10000);
            clock.pass(pause());
        }
    }

    void start() { application.start(); }

    // Starts the device, and runs it until the sensor is running.
    void start_and_settle() {
        start();
        run(305 * kMs);  // this run ends half-way between two sampling instants
        REQUIRE(!samples().empty());
    }

    std::vector<Frame> samples() const { return sink.of<fltea::Sample>(); }
    std::vector<Frame> faults() const { return sink.of<fltea::Fault>(); }
    fltea::Hello hello() const { return message_of<fltea::Hello>(sink.of<fltea::Hello>().back()); }
    fltea::Status status() const { return message_of<fltea::Status>(sink.of<fltea::Status>().back()); }

    // Returns the number of FAULT frames with this code so far.
    int fault_count(fltea::FaultCode code) const {
        int n = 0;
        for (const Frame& frame : faults()) n += message_of<fltea::Fault>(frame).code == code;
        return n;
    }
    // Returns the detail of the last FAULT with this code, or 0 if there is none.
    uint32_t fault_detail(fltea::FaultCode code) const {
        uint32_t detail = 0;
        for (const Frame& frame : faults()) {
            const fltea::Fault fault = message_of<fltea::Fault>(frame);
            if (fault.code == code) detail = fault.detail;
        }
        return detail;
    }

    // Gives the edges of the data-ready pin that are due by now. They come at the chip's own times, whatever
    // the main loop is doing.
    void edges() {
        if (next_edge_us_ > clock.us()) return;
        const bool pulses = chip.pulses();
        if (!pulses) next_edge_us_ += (clock.us() - next_edge_us_) / edge_period_us * edge_period_us;
        for (; next_edge_us_ <= clock.us(); next_edge_us_ += edge_period_us) {
            if (pulses) application.on_data_ready(static_cast<uint32_t>(next_edge_us_));
        }
    }

  private:
    uint64_t pause() {
        random_ = random_ * 6364136223846793005u + 1442695040888963407u;
        switch (calls) {
            case Calls::often:
                return 150;
            case Calls::every_tick:
                // A sleeping CPU is woken by its timer and by the data-ready pin.
                return std::min(kPeriodUs - clock.us() % kPeriodUs,
                                chip.pulses() ? next_edge_us_ - clock.us() : kPeriodUs);
            default:
                return (random_ >> 33) % 10000;
        }
    }

    uint64_t next_edge_us_;
    uint64_t random_ = 1;
};

// Checks that every sampling instant is accounted for. Two numbers have to be equal. One is the number of
// samples delivered, plus the overruns and dropped frames that STATUS counts. The other is the number of
// instants, which follows from the last sample's sequence number.
inline void check_balance(const Rig& rig) {
    const fltea::Status status = rig.status();
    const std::vector<Frame> samples = rig.samples();
    CHECK(samples.back().sequence + 1u == samples.size() + status.overruns + status.dropped_frames);
}

inline uint8_t last_flags(const Rig& rig) { return message_of<fltea::Sample>(rig.samples().back()).flags; }
