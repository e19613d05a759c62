// A libFuzzer test of loading saved states: of running spectra, of trackers, and of filters of every kind
// with their supervisors. The first byte of an input selects the kind of state. Each group of four bytes
// after it changes one number of a saved state: two bytes are the position, and two the change. If a changed
// state is accepted, it must be possible to process samples with it, also lost ones, and to save it again.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <vector>

#include "axis_bank.hpp"
#include "noise.h"
#include "number_io.hpp"
#include "octaves.hpp"
#include "one_axis.hpp"

using namespace fltea;

namespace {

typedef std::vector<double> Numbers;
typedef std::vector<unsigned char> Bytes;

constexpr std::uint64_t kLost[] = {1, 700, std::uint64_t(1) << 31,
                                   // numbers of samples that are lost at once; the last is the largest number
                                   // that is accepted
                                   1000000000000000ull};

void require(bool condition, const char* what) {
    if (condition) return;
    std::fprintf(stderr, "%s\n", what);
    std::abort();
}

Numbers noise(std::size_t n) {
    Noise next;
    Numbers y(n);
    for (double& one : y) one = next();
    return y;
}

// Changes the numbers in `bytes` as the fuzzer's input `data` prescribes, with four bytes for each change.
void change(unsigned char* bytes, std::size_t size, const std::uint8_t* data, std::size_t n) {
    static const double kOdd[] = {0,
                                  1,
                                  -1,
                                  2,
                                  0.5,
                                  127,
                                  128,
                                  129,
                                  1e15,
                                  -1e15,
                                  1e16,
                                  1e99,
                                  1.1e100,
                                  1e300,
                                  1e308,
                                  2147483648.0,
                                  9.3e18,
                                  5e-324,
                                  1e-300,
                                  std::numeric_limits<double>::infinity(),
                                  std::numeric_limits<double>::quiet_NaN()};
    const std::size_t words = size / sizeof(double), odd = sizeof kOdd / sizeof kOdd[0];
    for (; words > 0 && n >= 4; data += 4, n -= 4) {
        unsigned char* const where = bytes + (std::size_t(data[0]) << 8 | data[1]) % words * sizeof(double);
        double number;
        std::memcpy(&number, where, sizeof number);
        const int by = int(data[3]) - 128;
        number = data[2] < 100 ? number + by : data[2] < 150 ? std::ldexp(number, by) : kOdd[data[3] % odd];
        std::memcpy(where, &number, sizeof number);
    }
}

template <typename Lane>
Numbers saved(Lane& lane) {
    Numbers numbers;
    NumberSaver saver(numbers);
    lane.visit(saver);
    return numbers;
}

template <typename Lane>
bool load(Lane& lane, const Numbers& numbers) {
    NumberLoader loader(numbers.data(), numbers.data() + numbers.size());
    lane.visit(loader);
    return loader.sound() && loader.at_end();
}

// Loads a changed state into an object. If the state is accepted, calls `go_on`, which gives samples to the
// object and reads all its results.
template <typename Lane, typename GoOn>
void numbers_of(const Lane& fresh, Numbers numbers, const std::uint8_t* data, std::size_t n, GoOn go_on) {
    change(reinterpret_cast<unsigned char*>(numbers.data()), numbers.size() * sizeof(double), data, n);
    const std::unique_ptr<Lane> lane(new Lane(fresh)), again(new Lane(fresh));
    if (!load(*lane, numbers)) return;
    go_on(*lane);
    (void)load(*again, saved(*lane));
}

void octaves(double memory, const std::uint8_t* data, std::size_t n) {
    typedef Octaves<double> Lane;
    static const Numbers y = noise(6000);
    static std::map<double, Numbers> known;
    const std::unique_ptr<Lane> fresh(new Lane(memory));
    if (known[memory].empty()) {
        const std::unique_ptr<Lane> fed(new Lane(memory));
        fed->add(y.data(), y.size(), 1);
        known[memory] = saved(*fed);
    }
    numbers_of(*fresh, known[memory], data, n, [](Lane& lane) {
        for (const std::uint64_t lost : kLost) {
            lane.add(y.data(), 600, 1);
            lane.skip(lost);
        }
        lane.add(y.data(), 50, 1);
        const std::unique_ptr<Lane> copy(new Lane(lane.finished()));
        copy->deepen();
        typedef engine::OctaveLadder<RealSpectrum<double>> Ladder;
        double power[Ladder::kTopLines], blocks, effective;
        for (int l = 0; l < copy->ladder().depth(); ++l)
            copy->ladder().sums(l, copy->now(), power, &blocks, &effective);
        (void)copy->allan().points();
        lane.merge(*copy);
    });
}

// Returns a tracker's state after all samples `y`. If `with_system` is true, the tracker then gets a
// state-space model with two states as its filter, and the same samples `y` again.
Numbers tracked(const Numbers& y, bool with_system) {
    track::OneAxis fed;
    for (const double one : y) fed.next(one);
    if (with_system) {
        track::System<track::kMost> s = track::System<track::kMost>();
        s.n = 2;
        s.R = 1;
        s.a[0] = 0.9;
        s.a[1] = 1;
        for (int i = 0; i < 2; ++i) s.c[i] = s.bias[i] = s.P0[3 * i] = 1;
        s.state[0] = s.Q[0] = 0.1;
        require(fed.set(s), "the system is right");
        for (const double one : y) fed.next(one);
    }
    return saved(fed);
}

void tracker(bool with_system, const std::uint8_t* data, std::size_t n) {
    typedef track::OneAxis Lane;
    static const Numbers y = noise(3000);
    static Numbers known[2];
    if (known[with_system].empty()) known[with_system] = tracked(y, with_system);
    Numbers numbers = known[with_system];
    change(reinterpret_cast<unsigned char*>(numbers.data()), numbers.size() * sizeof(double), data, n);
    Lane lane, again;
    if (!load(lane, numbers)) return;
    for (const std::uint64_t lost : kLost) {
        for (std::size_t i = 0; i < 100; ++i) lane.next(y[i]);
        lane.skip(lost);
    }
    (void)lane.axis().whiteness().ljung_box();
    (void)lane.axis().likelihood();
    (void)load(again, saved(lane));
}

void lanes(int kind, const std::uint8_t* data, std::size_t n) {
    const std::size_t count = 3, rows = 64;  // rows of samples: 40 fill the start-up window, 24 more follow
    const engine::LaneSettings one = {std::log(0.01), 0, 0.01, 0.15, 0.0235, 0.5,  0.06, 0,
                                      0.17,           0, -0.1, 0.06, 0,      0.17, 0,    10};
    const std::vector<engine::LaneSettings> settings(count, one);
    const engine::EngineShape shape = {count, kind & 1, kind / 4 % 3, kind / 2 & 1, 0, 40};
    AxisBank bank(count);
    std::unique_ptr<LaneRunner> fed(new LaneRunner(engine::engine_baseline, shape, settings.data()));
    const Numbers bias(count, 0.0), y = noise(rows * count);
    const Bytes live(count, 1);
    Bytes flags(rows * count), whites(rows * count);
    Numbers out(kLaneColumns * rows * count);
    BankBlock block = {{}, flags.data(), whites.data()};
    for (std::size_t i = 0; i < kLaneColumns; ++i) block.columns[i] = out.data() + i * rows * count;
    std::vector<Lost> lost;
    LaneRunner& runner = *fed;
    bank.start(std::move(fed), bias.data(), live.data());
    bank.run(y.data(), rows, block, lost);
    Bytes engine_bytes = runner.save(), supervisors = runner.save_supervisors();
    if (n > 0 && data[0] & 1) {
        change(supervisors.data(), supervisors.size(), data + 1, n - 1);
    } else if (n > 0) {
        change(engine_bytes.data(), engine_bytes.size(), data + 1, n - 1);
    }
    if (!runner.load(engine_bytes.data(), engine_bytes.size()) ||
        !runner.load_supervisors(supervisors.data(), supervisors.size()))
        return;
    for (int i = 0; i < 3; ++i) {
        bank.run(y.data(), rows, block, lost);
        bank.skip(std::size_t(i) * 300, lost);
    }
    const Bytes later = runner.save();
    (void)runner.load(later.data(), later.size());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t n) {
    if (n == 0) return 0;
    const int kind = data[0] % 16;
    if (kind < 2) {
        octaves(kind == 0 ? 0 : 1000, data + 1, n - 1);
    } else if (kind < 4) {
        tracker(kind == 3, data + 1, n - 1);
    } else {
        lanes(kind - 4, data + 1, n - 1);
    }
    return 0;
}
