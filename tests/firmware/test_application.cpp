// Tests of the device without faults, and of what it reports about itself.
#include <doctest/doctest.h>

#include <string>

#include "rig.h"

using fltea::FaultCode;
using fltea::ResetCause;
using fltea::SamplingMode;

namespace {

fltea::Sample sample_of(const Frame& frame) { return message_of<fltea::Sample>(frame); }

}  // namespace

TEST_CASE("application: a new device says 0x00 and HELLO at once, with no sensor yet") {
    Rig rig;
    rig.start();
    REQUIRE(rig.sink.bytes.size() == 1 + fltea::wire_size<fltea::Hello>());
    CHECK(rig.sink.bytes[0] == 0);
    CHECK(rig.sink.bytes[1] != 0);
    const fltea::Hello hello = rig.hello();
    CHECK(int(hello.protocol_major) == int(fltea::kProtocolMajor));
    CHECK(int(hello.protocol_minor) == int(fltea::kProtocolMinor));
    CHECK(hello.schema_hash == uint32_t(fltea::kSchemaHash));
    CHECK(hello.boot_id == 0xB007B007);
    CHECK(hello.device_id[0] == 0xA0);
    CHECK(hello.device_id[15] == 0xAF);
    CHECK(hello.who_am_i == 0);
    CHECK(hello.sensor_starts == 0);
    CHECK(hello.sampling_mode == SamplingMode::timer);
    const std::string version = std::string(fltea::kVersion) + " due " + fltea::kBuildId;
    CHECK(std::string(hello.firmware_version, version.size()) == version);
    for (size_t i = version.size(); i < sizeof hello.firmware_version; ++i)
        CHECK(hello.firmware_version[i] == 0);
}

TEST_CASE("application: a version that is too long is cut") {
    FakeClock clock;
    FakeChip chip(clock);
    FakeBus bus(clock, chip);
    FakeSink sink(clock);
    fltea::Identity identity = test_identity();
    identity.port = "a port with a name of great length";
    fltea::Application application(bus, sink, clock, identity);
    application.start();
    const fltea::Hello hello = message_of<fltea::Hello>(sink.of<fltea::Hello>()[0]);
    const std::string whole = std::string(fltea::kVersion) + " " + identity.port;
    CHECK(std::string(hello.firmware_version, 24) == whole.substr(0, 24));
}

TEST_CASE("application: the default mode is that of the settings") {
    FakeClock clock;
    FakeChip chip(clock);
    FakeBus bus(clock, chip);
    FakeSink sink(clock);
    fltea::Application application(bus, sink, clock, test_identity());
    application.start();
    const fltea::Hello hello = message_of<fltea::Hello>(sink.of<fltea::Hello>()[0]);
    CHECK(hello.sampling_mode == SamplingMode(fltea::settings::kSamplingMode));
}

TEST_CASE("application: reset causes of the RSTC") {
    const ResetCause causes[] = {ResetCause::power_up, ResetCause::backup, ResetCause::watchdog,
                                 ResetCause::software, ResetCause::user};
    for (uint32_t i = 0; i < 5; ++i) CHECK(fltea::reset_cause_from_rsttyp(i) == causes[i]);
    CHECK(fltea::reset_cause_from_rsttyp(5) == ResetCause::unknown);
    CHECK(fltea::reset_cause_from_rsttyp(7) == ResetCause::unknown);
    CHECK(fltea::reset_cause_from_rsttyp(0x100) == ResetCause::unknown);
}

TEST_CASE("application: numbers of starts never come back to 0") {
    CHECK(fltea::start_number(0) == 0);
    CHECK(fltea::start_number(1) == 1);
    CHECK(fltea::start_number(65535) == 65535);
    CHECK(fltea::start_number(65536) == 1);
    CHECK(fltea::start_number(65537) == 2);
}

TEST_CASE("application: 100 Hz without a gap, in both modes, however it is stepped, over the clock's wrap") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        for (Rig::Calls calls : {Rig::Calls::often, Rig::Calls::every_tick}) {
            // The device starts at a multiple of the sampling period, as it does after a tick of the board's
            // timer.
            for (uint64_t start : {UINT64_C(0), kWrap - kWrap % kPeriodUs - 500 * kPeriodUs}) {
                CAPTURE(start);
                Rig rig(mode, start);
                rig.calls = calls;
                rig.start();
                rig.run(20 * kS);
                const std::vector<Frame> samples = rig.samples();
                REQUIRE(samples.size() >= 1975);
                for (size_t i = 0; i < samples.size(); ++i) {
                    REQUIRE(samples[i].sequence == i);
                    REQUIRE(sample_of(samples[i]).flags == 0);
                    if (i == 0) continue;
                    const uint32_t step = samples[i].device_us - samples[i - 1].device_us;
                    // In timer mode, step() is called every 150 us, so a sample may be read a little late. In
                    // data-ready mode, a sample's time is that of the edge of the data-ready pin.
                    REQUIRE(step >= (mode == SamplingMode::timer ? 9000 : 10000));
                    REQUIRE(step <= (mode == SamplingMode::timer ? 11000 : 10000));
                }
                const uint32_t whole = samples.back().device_us - samples[0].device_us;
                CHECK(static_cast<double>(whole) ==
                      doctest::Approx(static_cast<double>(samples.size() - 1) * 10000).epsilon(1e-4));
                CHECK(rig.faults().empty());
                const fltea::Status status = rig.status();
                CHECK(status.i2c_errors == 0);
                CHECK(status.bus_recoveries == 0);
                CHECK(status.sensor_reinits == 0);
                CHECK(status.overruns == 0);
                CHECK(status.dropped_frames == 0);
                CHECK(status.reset_cause == ResetCause::user);
            }
        }
    }
}

TEST_CASE("application: the values of the chip, at the instant before the burst began") {
    Rig rig;
    rig.calls = Rig::Calls::every_tick;
    rig.start_and_settle();
    const Frame frame = rig.samples()[3];
    const fltea::Sample sample = sample_of(frame);
    CHECK(sample.accel_x == rig.chip.life);
    CHECK(sample.accel_y == -1);
    CHECK(sample.accel_z == 16384);
    CHECK(sample.temperature == -256);
    CHECK(sample.gyro_x == 4);
    CHECK(sample.gyro_y == 7);
    CHECK(sample.gyro_z == -30000);
    CHECK(frame.device_us % kPeriodUs == 0);
}

TEST_CASE(
    "application: HELLO before the first sample and every second, STATUS every second half a second later, "
    "in "
    "mid-period whenever the board was up") {
    uint64_t boot_us = 0;
    SUBCASE("at an instant") {}
    SUBCASE("behind it") { boot_us = 2500; }
    SUBCASE("just before the next") { boot_us = kPeriodUs - 50; }
    Rig rig(SamplingMode::timer, boot_us);
    rig.start();
    rig.run(10 * kS + 100 * kMs);
    const std::vector<Frame>& frames = rig.sink.receiver.frames;
    size_t first_sample = 0;
    while (frames[first_sample].type != fltea::Sample::type()) ++first_sample;
    // A HELLO and an ESTIMATOR (the settings of the estimates) precede the first sample.
    REQUIRE(frames[first_sample - 2].type == fltea::Hello::type());
    CHECK(message_of<fltea::Hello>(frames[first_sample - 2]).sensor_starts == 1);
    CHECK(frames[first_sample - 1].type == fltea::Estimator::type());

    const std::vector<Frame> hellos = rig.sink.of<fltea::Hello>();
    // one HELLO at boot, one when the sensor runs, and one in each of ten seconds
    REQUIRE(hellos.size() == 12);
    for (size_t i = 0; i < hellos.size(); ++i) CHECK(hellos[i].sequence == i);
    for (size_t i = 2; i < hellos.size(); ++i) {
        const uint64_t due = (i - 1) * kS - kPeriodUs / 2;
        CHECK(hellos[i].device_us >= due);
        CHECK(hellos[i].device_us < due + 2 * kMs);
    }
    const std::vector<Frame> statuses = rig.sink.of<fltea::Status>();
    REQUIRE(statuses.size() == 10);
    for (size_t i = 0; i < statuses.size(); ++i) {
        CHECK(statuses[i].sequence == i);
        const uint64_t due = kS / 2 + i * kS - kPeriodUs / 2;
        CHECK(statuses[i].device_us >= due);
        CHECK(statuses[i].device_us < due + 2 * kMs);
    }
}

TEST_CASE("application: values that do not change and axes at their end are flagged") {
    Rig rig;
    rig.start_and_settle();
    rig.chip.frozen = true;
    rig.run(50 * kMs);
    CHECK(sample_of(rig.samples().back()).flags == fltea::sample_flags::repeated);
    rig.chip.gyro_y = INT16_MIN;
    rig.run(10 * kMs);
    CHECK(sample_of(rig.samples().back()).flags == fltea::sample_flags::saturated);
    rig.run(10 * kMs);
    CHECK(sample_of(rig.samples().back()).flags ==
          (fltea::sample_flags::saturated | fltea::sample_flags::repeated));
    rig.chip.frozen = false;
    rig.chip.gyro_y = INT16_MAX;
    rig.run(10 * kMs);
    CHECK(sample_of(rig.samples().back()).flags == fltea::sample_flags::saturated);
}

TEST_CASE("application: read more than a tenth of a period late is flagged, at a tenth it is not") {
    for (uint64_t late_us : {999, 1000, 1001, 5000}) {
        CAPTURE(late_us);
        Rig rig;
        rig.calls = Rig::Calls::every_tick;
        rig.start_and_settle();
        rig.clock.pass(kPeriodUs - rig.clock.us() % kPeriodUs + late_us);
        rig.application.step();
        const Frame frame = rig.samples().back();
        REQUIRE(frame.device_us % kPeriodUs == late_us);
        CHECK(sample_of(frame).flags == (late_us > 1000 ? fltea::sample_flags::late : 0));
    }
}

TEST_CASE(
    "application: in data-ready mode the stamp is the edge's, however late the read, which is flagged") {
    Rig rig(SamplingMode::data_ready);
    rig.start_and_settle();
    rig.calls = Rig::Calls::unevenly;
    rig.run(2 * kS);
    int late = 0;
    for (const Frame& frame : rig.samples()) {
        REQUIRE(frame.device_us % kPeriodUs == 0);
        late += (sample_of(frame).flags & fltea::sample_flags::late) != 0;
    }
    CHECK(late > 20);
}

TEST_CASE("application: a stall of 50 ms costs what passed, counted, and nothing drifts") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        Rig rig(mode);
        rig.calls = Rig::Calls::every_tick;
        rig.start_and_settle();
        const Frame before = rig.samples().back();
        const size_t n = rig.samples().size();
        rig.clock.pass(50 * kMs);
        rig.run(2 * kS);
        const Frame after = rig.samples()[n];
        CHECK(after.sequence - before.sequence >= 5);
        CHECK(rig.status().overruns == after.sequence - before.sequence - 1u);
        const uint32_t us = rig.samples().back().device_us - rig.samples()[0].device_us;
        CHECK(us == rig.samples().back().sequence * 10000u);
    }
}

TEST_CASE("application: the number wraps from 65535 to 0 and nothing else happens") {
    Rig rig;
    rig.calls = Rig::Calls::every_tick;
    rig.start();
    rig.sink.size = 100000;
    rig.run(660 * kS);
    const std::vector<Frame> samples = rig.samples();
    REQUIRE(samples.size() > 65600);
    for (size_t i = 0; i < samples.size(); ++i) REQUIRE(samples[i].sequence == static_cast<uint16_t>(i));
    CHECK(rig.status().overruns == 0);
}

TEST_CASE(
    "application: the ends of 2^32 milliseconds and of 2^32 instants, after 49 and 497 days, are no event") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        for (uint64_t end_us : {kWrap * kMs, kWrap * kPeriodUs}) {
            // In data-ready mode, 2^32 instants are four billion edges, which would take too long to
            // simulate. So these are tested in timer mode only. Edges are numbered in the same way.
            if (mode == SamplingMode::data_ready && end_us > kWrap * kMs) continue;
            CAPTURE(end_us);
            Rig rig(mode);
            rig.calls = Rig::Calls::every_tick;
            rig.sink.size = 1000;
            rig.start_and_settle();
            // Months pass in steps of half an hour, during which the program does not run. The sampling
            // instants of this time are counted nevertheless.
            const uint64_t half_hour = 1800 * kS;
            while (rig.clock.us() < end_us - 10 * kS) {
                rig.clock.pass(std::min(half_hour, end_us - 10 * kS - rig.clock.us()));
                rig.run(20 * kMs);
            }
            rig.sink.receiver.frames.clear();
            rig.calls = Rig::Calls::often;
            rig.run(20 * kS);
            const std::vector<Frame> samples = rig.samples();
            CHECK(samples.size() >= 1999);
            for (size_t i = 1; i < samples.size(); ++i) {
                const Frame &before = samples[i - 1], &after = samples[i];
                REQUIRE(after.sequence == static_cast<uint16_t>(before.sequence + 1));
                REQUIRE(sample_of(after).flags == 0);
            }
            CHECK(rig.sink.of<fltea::Hello>().size() == 20);
            CHECK(rig.sink.of<fltea::Status>().size() == 20);
            CHECK(rig.sink.of<fltea::Estimate>().size() >= 3 * 140);
            CHECK(rig.faults().empty());
        }
    }
}

TEST_CASE("application: a clock of the sensor that is one per cent off gives its rate and no gap") {
    for (uint64_t period : {9900, 10100}) {
        Rig rig(SamplingMode::data_ready);
        rig.edge_period_us = period;
        rig.start();
        rig.run(20 * kS);
        const std::vector<Frame> samples = rig.samples();
        for (size_t i = 0; i < samples.size(); ++i) REQUIRE(samples[i].sequence == i);
        CHECK(samples.back().device_us - samples[0].device_us == (samples.size() - 1) * period);
        CHECK(rig.status().overruns == 0);
    }
}
