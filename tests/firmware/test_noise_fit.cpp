// Tests of the device's noise fits, which run in small slices. Their results are compared with those of the
// same spectra and fits computed without slices, also with lost samples.
#include "engine/sensor_motion.hpp"
#include "engine/sliced_fit.hpp"
#include "noise_fit_rig.h"

namespace {

// `fit`: the fits of three axes that are tested; they run in slices. `alone`: a spectrum of each axis, from
// the same samples. From these spectra, the expected results are computed without slices.
struct Fitting {
    std::unique_ptr<NoiseFit> fit{new NoiseFit};
    std::vector<std::unique_ptr<Octaves>> alone;
    std::vector<whittle::FitMemory> memory{whittle::FitMemory(0), whittle::FitMemory(4),
                                           whittle::FitMemory(8)};
    std::vector<Counts> noise;
    std::vector<Fit> fits;
    std::vector<Spectrum> spectra;

    explicit Fitting(double slow = 0.5) {
        fit->begin();
        for (unsigned i = 0; i < 3; ++i) {
            noise.emplace_back(i + 1, slow);
            alone.emplace_back(new Octaves);
            fit->start(i);
        }
    }
    void add() {
        for (size_t i = 0; i < 3; ++i) {
            const int16_t count = noise[i]();
            fit->add(i, count);
            alone[i]->add(count);
            while (fit->passing()) fit->pass();
        }
    }
    void skip(uint16_t lost) {
        fit->skip(lost);
        for (auto& one : alone) one->skip(lost);
    }
    // Runs at most `most` slices of the fits, as long as there is work.
    void work(int most = 1000000) {
        for (int n = 0; n < most && fit->busy(); ++n) {
            Fit message = {};
            Spectrum spectrum = {};
            switch (fit->work(message, spectrum)) {
                case NoiseFit::Told::fit:
                    fits.push_back(message);
                    break;
                case NoiseFit::Told::spectrum:
                    spectra.push_back(spectrum);
                    break;
                default:
                    break;
            }
        }
    }
    // Fits one axis without slices. The bins of its spectrum are in `bins` afterwards.
    Bins bins;
    whittle::FitFigures at_once(size_t axis) {
        bins.begin();
        while (!bins.step(*alone[axis])) {
        }
        whittle::SlicedFit<Bins> sliced;
        sliced.begin(bins, whittle::kFivePercent, memory[axis]);
        while (!sliced.work(bins)) {
        }
        return memory[axis].figures();
    }
};

uint32_t first_fit(const Fitting& f) { return f.fits.front().age; }

}  // namespace

TEST_CASE("noise fit: what it says is what the spectrum and the fit say without slices") {
    Fitting f;
    size_t compared = 0;
    for (int k = 0; k < 9000; ++k) {
        f.add();
        if (k == 1500) f.skip(3);
        if (k == 4000) f.skip(700);
        f.work();
        for (; compared < f.fits.size(); ++compared) {
            const Fit& said = f.fits[compared];
            const size_t axis = static_cast<size_t>(said.axis);
            REQUIRE(axis == compared % 3);
            const whittle::FitFigures expected = f.at_once(axis);
            CHECK(int(said.verdict) == int(expected.verdict));
            CHECK(said.alpha == expected.alpha);
            CHECK(said.alpha_std == expected.alpha_std);
            CHECK(said.ratio_white == expected.ratio_white);
            CHECK(said.ratio_relaxation == expected.ratio_ar1);
            CHECK(said.ordinates == expected.ordinates);
            CHECK(said.s2 == doctest::Approx(expected.s2 / (kCountsPerDps * kCountsPerDps)).epsilon(1e-6));
            CHECK(said.r == doctest::Approx(expected.R / (kCountsPerDps * kCountsPerDps)).epsilon(1e-6));
            // the parameter f = g h^-α, where h is the sampling period and g the feedback per sample
            const double h = 1e-6 * settings::kSamplePeriodUs;
            CHECK(static_cast<double>(said.f) ==
                  doctest::Approx(static_cast<double>(expected.g) * std::pow(h, -said.alpha)).epsilon(1e-4));
            CHECK(((said.flags & fltea::fit_flags::alpha_defined) != 0) == expected.alpha_defined);
            CHECK(said.number == compared / 3 + 1);
            CHECK(said.age == static_cast<uint32_t>(k + 1 + (k >= 1500 ? 3 : 0) + (k >= 4000 ? 700 : 0)));
            CHECK(said.used == f.alone[axis]->counts().used);
        }
    }
    // The first fit comes after 1,000 samples. After a round of fits (one for each axis), at least kFitEvery
    // samples pass until the next round.
    REQUIRE(f.fits.size() >= 3 * 27);
    CHECK(first_fit(f) == 1000);
    for (size_t i = 3; i < f.fits.size(); ++i) {
        const uint32_t apart = f.fits[i].age - f.fits[i - 3].age;
        CHECK(apart >= settings::kFitEvery);
        CHECK(apart <= settings::kFitEvery + 703u);
    }
    // The noise of this test is not white, and the last fit has to find that.
    CHECK(f.fits.back().verdict != fltea::FitVerdict::white);
}

TEST_CASE("noise fit: a spectrum that goes on while it is read is read again") {
    Fitting f;
    for (int k = 0; k < 1000; ++k) f.add();
    // With only three slices of work per sample, 128 more samples come while the bins are made. They change
    // the spectrum, so the bins have to be made again.
    int k = 1000;
    for (; f.fits.empty(); ++k) {
        REQUIRE(k < 200000);
        f.add();
        f.work(3);
    }
    CHECK(f.fits[0].age > 1000);
    // The fit states in its field `age` how many samples it has used. Its result is the one that a spectrum
    // of so many samples gives.
    Fitting again;
    for (uint32_t n = 0; n < f.fits[0].age; ++n) again.add();
    const whittle::FitFigures expected = again.at_once(0);
    CHECK(f.fits[0].alpha == expected.alpha);
    CHECK(f.fits[0].ordinates == expected.ordinates);
    CHECK(f.fits[0].used == again.alone[0]->counts().used);
}

TEST_CASE("noise fit: bins are sent with the first fit of an axis and every tenth, in order and all") {
    Fitting f;
    for (int k = 0; k < 5000; ++k) {
        f.add();
        const size_t fits = f.fits.size(), spectra = f.spectra.size();
        f.work();
        if (f.fits.size() == fits) {
            CHECK(f.spectra.size() == spectra);
            continue;
        }
        REQUIRE(f.fits.size() == fits + 3);
        size_t at = spectra;
        for (size_t axis = 0; axis < 3; ++axis) {
            const Fit& said = f.fits[fits + axis];
            if (said.number % settings::kSpectrumEvery != 1) continue;
            f.at_once(axis);
            for (int bin = 0; bin < f.bins.size(); bin += 5, ++at) {
                REQUIRE(at < f.spectra.size());
                const Spectrum& one = f.spectra[at];
                CHECK(static_cast<size_t>(one.axis) == axis);
                CHECK(one.number == said.number);
                CHECK(one.first == bin);
                CHECK(one.total == f.bins.size());
                const double rate = 1e6 / settings::kSamplePeriodUs, turn = 6.283185307179586;
                CHECK(static_cast<double>(one.frequency_0) ==
                      doctest::Approx(static_cast<double>(f.bins.lam(bin)) * rate / turn).epsilon(1e-5));
                CHECK(one.ordinates_0 == f.bins.counts(bin));
                const double density = 2 * static_cast<double>(f.bins.power(bin)) /
                                       (rate * static_cast<double>(kCountsPerDps * kCountsPerDps));
                CHECK(static_cast<double>(one.density_0) == doctest::Approx(density).epsilon(1e-5));
                const bool last_there = bin + 4 < f.bins.size();
                CHECK((one.ordinates_4 == (last_there ? f.bins.counts(bin + 4) : 0.0f)));
                CHECK((one.frequency_4 > 0) == last_there);
            }
        }
        CHECK(at == f.spectra.size());
    }
    CHECK(f.fits.back().number == 14);
}

TEST_CASE("noise fit: an axis that never changed is left out, and the others are fitted") {
    for (size_t constant = 0; constant < 3; ++constant) {
        std::unique_ptr<NoiseFit> fit(new NoiseFit);
        fit->begin();
        for (size_t i = 0; i < 3; ++i) {
            if (i != constant) fit->start(i);
        }
        Counts noise(1);
        std::vector<size_t> axes;
        for (int k = 0; k < 1400; ++k) {
            for (size_t i = 0; i < 3; ++i) {
                fit->add(i, i == constant ? int16_t(7) : noise());
                while (fit->passing()) fit->pass();
            }
            while (fit->busy()) {
                Fit message = {};
                Spectrum spectrum = {};
                if (fit->work(message, spectrum) == NoiseFit::Told::fit) {
                    axes.push_back(static_cast<size_t>(message.axis));
                }
            }
        }
        REQUIRE(axes.size() == 4);
        for (size_t i = 0; i < axes.size(); ++i) {
            CHECK(axes[i] != constant);
            CHECK(axes[i] == axes[i % 2]);
        }
    }
}

TEST_CASE("noise fit: begun again it knows nothing of before") {
    Fitting f;
    for (int k = 0; k < 2500; ++k) {
        f.add();
        f.work();
    }
    f.add();
    f.fit->begin();
    CHECK(!f.fit->busy());
    CHECK(!f.fit->passing());
    f.fits.clear();
    Fitting fresh;
    for (size_t i = 0; i < 3; ++i) {
        f.noise[i] = Counts(static_cast<unsigned>(i + 1));
        f.fit->start(i);
    }
    for (int k = 0; k < 1500; ++k) {
        for (Fitting* one : {&f, &fresh}) {
            one->add();
            one->work();
        }
    }
    REQUIRE(f.fits.size() == fresh.fits.size());
    REQUIRE(!f.fits.empty());
    for (size_t i = 0; i < f.fits.size(); ++i) {
        CHECK(f.fits[i].alpha == fresh.fits[i].alpha);
        CHECK(f.fits[i].number == fresh.fits[i].number);
        CHECK(f.fits[i].age == fresh.fits[i].age);
    }
}

TEST_CASE("noise fit: begun again without an axis it leaves that axis out") {
    Fitting f;
    for (int k = 0; k < 1500; ++k) {
        f.add();
        f.work();
    }
    REQUIRE(f.fits.size() >= 3);
    f.fits.clear();
    f.fit->begin();
    f.fit->start(2);
    for (int k = 0; k < 1500; ++k) {
        f.add();
        f.work();
    }
    REQUIRE(!f.fits.empty());
    for (const Fit& one : f.fits) CHECK(one.axis == fltea::Axis::gyro_z);
}

TEST_CASE("noise fit: bins carry the number of their own axis's fit") {
    // The third axis has no fits at first, because it starts later.
    std::unique_ptr<NoiseFit> fit(new NoiseFit);
    fit->begin();
    std::vector<Counts> noise;
    for (unsigned i = 0; i < 3; ++i) noise.emplace_back(i + 1);
    uint16_t newest[3] = {0, 0, 0};
    size_t told[3] = {0, 0, 0};
    for (size_t i = 0; i < 2; ++i) fit->start(i);
    for (int k = 0; k < 6000; ++k) {
        if (k == 2000) fit->start(2);
        for (size_t i = 0; i < 3; ++i) {
            fit->add(i, noise[i]());
            while (fit->passing()) fit->pass();
        }
        while (fit->busy()) {
            Fit message = {};
            Spectrum spectrum = {};
            const NoiseFit::Told what = fit->work(message, spectrum);
            if (what == NoiseFit::Told::fit) {
                CHECK(message.number == ++newest[static_cast<size_t>(message.axis)]);
                // A fit evaluates the likelihood of each of the four models at least once.
                const bool any = message.verdict != fltea::FitVerdict::none;
                CHECK((any ? message.evaluations >= 4 : message.evaluations == 0));
            }
            if (what == NoiseFit::Told::spectrum) {
                CHECK(spectrum.number == newest[static_cast<size_t>(spectrum.axis)]);
                ++told[static_cast<size_t>(spectrum.axis)];
            }
        }
    }
    CHECK(newest[0] > newest[2]);
    for (size_t one : told) CHECK(one > 0);
}

TEST_CASE("noise fit: an axis is tracked by its newest fit, lost samples predicted") {
    Fitting f;
    whittle::TrackedState alone[3];
    size_t set = 0;
    for (int k = 0; k < 4000; ++k) {
        if (k == 1500 || k == 2500) {
            const uint16_t lost = k == 1500 ? 3 : 70;
            f.skip(lost);
            for (whittle::TrackedState& one : alone) one.skip(lost);
        }
        std::vector<Counts> same = f.noise;
        f.add();
        for (size_t i = 0; i < 3; ++i) alone[i].next(same[i]());
        f.work();
        for (; set < f.fits.size(); ++set) {
            const size_t i = static_cast<size_t>(f.fits[set].axis);
            whittle::FilterDesign design;
            design.begin(f.at_once(i), 100);
            while (!design.work()) {
            }
            alone[i].set(design.filter());
        }
        for (size_t i = 0; i < 3; ++i) {
            fltea::Estimate message = {};
            f.fit->track(i, message);
            REQUIRE(((message.flags & fltea::estimate_flags::tracked) != 0) == alone[i].known());
            if (!alone[i].known()) {
                REQUIRE(message.tracker_bias == 0);
                continue;
            }
            const whittle::TrackedState::Figures expected = alone[i].figures(whittle::Unlearned());
            REQUIRE(message.tracker_bias == expected.bias / kCountsPerDps);
            REQUIRE(message.tracker_bias_std == expected.bias_std / kCountsPerDps);
            REQUIRE(message.tracker_state == expected.state / kCountsPerDps);
            REQUIRE(message.tracker_state_std == expected.state_std / kCountsPerDps);
        }
    }
    CHECK(set >= 3 * 9);
    // After begin(), an axis has no fit.
    f.fit->begin();
    f.fit->start(0);
    fltea::Estimate message = {};
    f.fit->track(0, message);
    CHECK((message.flags & fltea::estimate_flags::tracked) == 0);
}

TEST_CASE("noise fit: rounds go on at their pace when the count of samples wraps, after 497 days") {
    Fitting f;
    for (int k = 0; k < 1200; ++k) f.add();
    f.work();
    const uint32_t short_of_it = 2000;
    uint32_t age = 1200;
    while (age < 0u - short_of_it) {
        const uint32_t left = 0u - short_of_it - age;
        const uint16_t lost = static_cast<uint16_t>(left < 0xFFFF ? left : 0xFFFF);
        f.fit->skip(lost);
        age += lost;
        if (lost < 0xFFFF || age % 0x10000000u < 0xFFFF) f.work();
    }
    f.fits.clear();
    for (int k = 0; k < 4000; ++k) {
        f.add();
        f.work();
    }
    REQUIRE(f.fits.size() >= 3 * 12);
    CHECK(f.fits.size() <= 3 * 14);
    for (size_t i = 3; i < f.fits.size(); ++i)
        CHECK(f.fits[i].age - f.fits[i - 3].age == settings::kFitEvery);
    CHECK(f.fits.front().age > f.fits.back().age);
}

TEST_CASE("noise fit: white noise is rejected at 5 %, not later") {
    Fitting f(0.15);
    int between = 0;
    for (int k = 0; k < 30000; ++k) {
        f.add();
        f.work();
    }
    for (const Fit& fit : f.fits) {
        const float five = whittle::null_quantile(whittle::kFivePercent, fit.ordinates);
        const float one = whittle::null_quantile(whittle::kOnePercent, fit.ordinates);
        CHECK((fit.verdict == fltea::FitVerdict::white) == (fit.ratio_white < five));
        between += five < fit.ratio_white && fit.ratio_white < one;
    }
    CHECK(between > 0);
}
