// Tests of the noise fits as part of the whole device: with lost samples, with motion, and that no sample
// waits for a slice of a fit.
#include "noise_fit_rig.h"

TEST_CASE("noise fit: a board that was moved in its start-up window fits as one that rested") {
    for (double moved : {0.0, 20.0, 550.0, 4000.0}) {
        std::unique_ptr<fltea::Estimation> moving(new fltea::Estimation), resting(new fltea::Estimation);
        std::vector<Fit> fits[2];
        fltea::Estimation* const both[] = {moving.get(), resting.get()};
        for (size_t i = 0; i < 2; ++i) {
            std::mt19937 random(7);
            std::normal_distribution<double> white(0, 1.64);
            both[i]->begin();
            for (uint32_t k = 0; k < settings::kStartup + 20000; ++k) {
                const double angle = 0.05 * k, turned = i == 0 && k < settings::kStartup ? moved : 0;
                fltea::Sample sample = {};
                for (int16_t* one : {&sample.gyro_x, &sample.gyro_y, &sample.gyro_z}) {
                    *one = static_cast<int16_t>(std::floor(turned * std::sin(angle) + white(random) + 0.5));
                }
                both[i]->add(sample, k);
                fltea::Estimate estimate = {};
                while (both[i]->busy()) both[i]->work(estimate);
                while (both[i]->noise().busy()) {
                    Fit message = {};
                    Spectrum spectrum = {};
                    if (both[i]->noise().work(message, spectrum) == NoiseFit::Told::fit) {
                        fits[i].push_back(message);
                    }
                }
            }
        }
        CAPTURE(moved);
        REQUIRE(fits[0].size() == fits[1].size());
        REQUIRE(fits[0].size() > 100);
        int whites = 0;
        for (size_t k = 0; k < fits[0].size(); ++k) {
            CHECK(fits[0][k].alpha == fits[1][k].alpha);
            CHECK(fits[0][k].r == fits[1][k].r);
            CHECK(fits[0][k].ratio_white == fits[1][k].ratio_white);
            whites += fits[0][k].verdict == fltea::FitVerdict::white;
        }
        CHECK(whites > static_cast<int>(fits[0].size()) * 4 / 5);
    }
}

namespace {

// `estimation`: the estimation that is tested, after its start-up window. `expected`: the spectrum that it
// should have, which the test computes from the samples that the estimation has to use.
struct Followed {
    std::unique_ptr<fltea::Estimation> estimation{new fltea::Estimation};
    std::vector<Octaves> expected{1};
    Counts noise{9};
    uint32_t instant = 0;
    uint32_t taken = 0;  // number of samples since the start-up window

    Followed() {
        estimation->begin();
        for (uint32_t k = 0; k < settings::kStartup; ++k) {
            add();
            work();
        }
    }

    int16_t add() {
        fltea::Sample sample = {};
        sample.gyro_x = sample.gyro_y = sample.gyro_z = noise();
        estimation->add(sample, instant++);
        return sample.gyro_x;
    }
    void add_expected() {
        expected[0].add(add());
        ++taken;
    }
    void work() {
        fltea::Estimate estimate = {};
        while (estimation->busy()) estimation->work(estimate);
    }
    void run(uint32_t n) {
        for (uint32_t k = 0; k < n; ++k) {
            add_expected();
            work();
        }
    }

    // Makes a fit, and compares the samples that it has used with those that are expected.
    void check_fit(uint32_t lost) {
        Fit fit = {};
        Spectrum spectrum = {};
        REQUIRE(estimation->noise().busy());
        while (estimation->noise().work(fit, spectrum) != NoiseFit::Told::fit) {
        }
        CHECK(fit.age == taken + lost);
        CHECK(fit.used == expected[0].counts().used);
        Bins bins;
        bins.begin();
        while (!bins.step(expected[0])) {
        }
        CHECK(fit.ordinates == bins.ordinates());
    }
};

}  // namespace

TEST_CASE("noise fit: samples that found the queue full are lost to the spectrum, and counted by it") {
    Followed device;
    device.run(700);
    // The queue fills with 32 samples, and the next seven are skipped. After that, samples are processed
    // again.
    for (int k = 0; k < 32; ++k) device.add_expected();
    for (int k = 0; k < 7; ++k) device.add();
    device.work();
    device.expected[0].skip(7);
    device.run(1300);
    device.check_fit(7);
    Estimator report;
    device.estimation->report(report);
    CHECK(report.skipped == 7);
    CHECK(report.fit_every == settings::kFitEvery);
}

TEST_CASE("noise fit: samples that were lost on the bus are lost to the spectrum") {
    Followed device;
    device.run(1600);
    device.instant += 5;
    device.expected[0].skip(5);
    device.run(400);
    device.check_fit(5);
}

namespace {

// This function, unless it is null, is called before every slice of a fit.
std::function<void()> before_slice;

}  // namespace

// The linker replaces NoiseFit::work by this function (Makefile).
extern "C" NoiseFit::Told __real__ZN5fltea8NoiseFit4workERNS_3FitERNS_8SpectrumE(NoiseFit*, Fit&, Spectrum&);
extern "C" NoiseFit::Told __wrap__ZN5fltea8NoiseFit4workERNS_3FitERNS_8SpectrumE(NoiseFit* fit, Fit& message,
                                                                                 Spectrum& spectrum) {
    if (before_slice) before_slice();
    return __real__ZN5fltea8NoiseFit4workERNS_3FitERNS_8SpectrumE(fit, message, spectrum);
}

TEST_CASE("noise fit: slices stay within their share of the time, and no sample waits for one") {
    for (SamplingMode mode : {SamplingMode::timer, SamplingMode::data_ready}) {
        for (size_t ring : {127u, 511u}) {
            for (uint64_t slice_us : {300u, 1500u}) {
                CAPTURE(ring);
                CAPTURE(slice_us);
                Estimating rig(mode);
                rig.axis_us = 400;
                rig.sink.size = ring;
                std::vector<uint64_t> begun_us;
                before_slice = [&] {
                    begun_us.push_back(rig.clock.us());
                    rig.pass(slice_us);
                };
                rig.start();
                rig.run((slice_us == 300 ? 40 : 25) * kS);
                before_slice = nullptr;
                check_every_sample(rig);
                REQUIRE(begun_us.size() > 100);
                // The fits may take kFitShare per cent of the time. What they do not use in one second is
                // saved for later. So in four seconds, they take at most this percentage of five seconds, and
                // the last slices may exceed that a little.
                for (size_t first = 0, last = 0; last < begun_us.size(); ++last) {
                    while (begun_us[last] - begun_us[first] > 4 * kS) ++first;
                    const double took = static_cast<double>((last - first + 1) * slice_us);
                    const double share = 0.01 * settings::kFitShare;
                    REQUIRE(took <= share * 5 * kS + 2.0 * static_cast<double>(slice_us));
                }
                const Estimator said = rig.estimator();
                CHECK(said.longest_slice >= slice_us);
                CHECK(said.longest_slice < slice_us + 100);
                CHECK(said.skipped == 0);
                CHECK(said.fit_every == settings::kFitEvery);
                const std::vector<Frame> fits = rig.sink.of<Fit>();
                if (slice_us > 300) continue;
                REQUIRE(!fits.empty());
                for (size_t i = 0; i < fits.size(); ++i) {
                    CHECK(fits[i].sequence == i);
                    CHECK(static_cast<size_t>(message_of<Fit>(fits[i]).axis) == i % 3);
                }
                // The SPECTRUM messages with the bins follow a FIT. Each states the index of its first bin.
                const std::vector<Frame> spectra = rig.sink.of<Spectrum>();
                REQUIRE(!spectra.empty());
                CHECK(message_of<Spectrum>(spectra[0]).first == 0);
                CHECK(message_of<Spectrum>(spectra[1]).first == 5);
            }
        }
    }
}

TEST_CASE("noise fit: a sensor that was set up again is fitted again") {
    Estimating rig;
    rig.axis_us = 100;
    rig.sink.size = 511;
    rig.start();
    rig.run(18 * kS);
    const std::vector<Frame> before = rig.sink.of<Fit>();
    REQUIRE(!before.empty());
    CHECK(message_of<Fit>(before.front()).number == 1);
    rig.bus.plugged = false;
    rig.run(100 * kMs);
    rig.bus.plugged = true;
    rig.run(12 * kS);
    CHECK(rig.sink.of<Fit>().size() == before.size());
    rig.run(6 * kS);
    const std::vector<Frame> after = rig.sink.of<Fit>();
    REQUIRE(after.size() > before.size());
    const Fit first = message_of<Fit>(after[before.size()]);
    CHECK(first.number == 1);
    CHECK(first.age >= 1000);
    CHECK(first.age < 1300);
    CHECK((first.flags & fltea::fit_flags::searched) != 0);
}

TEST_CASE("noise fit: what waits for the line when a new window begins is not sent") {
    Estimating rig;
    rig.axis_us = 100;
    rig.sink.size = 511;
    rig.start();
    while (rig.sink.of<Spectrum>().size() < 3) {
        REQUIRE(rig.clock.us() < 60 * kS);
        rig.run(kMs);
    }
    rig.sink.jammed = true;
    rig.run(400 * kMs);
    const size_t fits = rig.sink.of<Fit>().size(), spectra = rig.sink.of<Spectrum>().size();
    const uint16_t begun = rig.estimator().begun;
    rig.pass((settings::kMaxGap + 5) * kPeriodUs);
    rig.sink.jammed = false;
    rig.run(10 * kS);
    CHECK(rig.estimator().begun == begun + 1);
    CHECK(rig.sink.of<Fit>().size() == fits);
    CHECK(rig.sink.of<Spectrum>().size() == spectra);
}
