// Tests of the code that runs the filters of a sensor's axes on the host. tests/estimator compares its
// numbers with a plain computation in Python. The tests here check accesses to memory, undefined behaviour,
// and that neither the division of samples into calls nor snapshots change the results.
#include <doctest/doctest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "axis_bank.hpp"
#include "noise.h"

using namespace fltea;

namespace {

std::vector<double> noise(std::size_t n, double size = 0.15) {
    Noise next;
    std::vector<double> y(n);
    for (double& one : y) one = size * next();
    return y;
}

const engine::LaneSettings kTriple = {std::log(0.01), 0,   0.01, 0.15, 0.0235, 1,      0.01, 0.1,
                                      0.0235,         0.5, 0,    0.01, 0.1,    0.0235, 0.5,  10};

std::unique_ptr<LaneRunner> lanes_of(std::size_t lanes, int guard, double R = 0.0235) {
    engine::LaneSettings one = kTriple;
    one.R = one.order_R = one.parameter_R = R;
    const std::vector<engine::LaneSettings> settings(lanes, one);
    const engine::EngineShape shape = {lanes, 0, guard, 1, 0, 40};
    return std::unique_ptr<LaneRunner>(new LaneRunner(engine::engine_baseline, shape, settings.data()));
}

// Memory of the right size for a block of estimates.
struct Room {
    Room(std::size_t rows, std::size_t lanes)
        : numbers(kLaneColumns * rows * lanes, -1),
          flags(rows * lanes, 7),
          whites(rows * lanes, 7),
          size(rows * lanes) {
        for (std::size_t i = 0; i < kLaneColumns; ++i) block.columns[i] = numbers.data() + i * size;
        block.valid = flags.data();
        block.white = whites.data();
    }
    Room(const Room&) = delete;  // a copy is forbidden, because its pointers would point into the original
    Room(Room&&) = default;
    // Returns the part of the block of estimates from row `from` on.
    BankBlock at(std::size_t from, std::size_t lanes) const {
        BankBlock result = block;
        for (double*& column : result.columns) column += from * lanes;
        result.valid += from * lanes;
        result.white += from * lanes;
        return result;
    }
    bool operator==(const Room& other) const {
        return flags == other.flags && whites == other.whites &&
               std::memcmp(numbers.data(), other.numbers.data(), numbers.size() * sizeof(double)) == 0;
    }

    std::vector<double> numbers;
    std::vector<std::uint8_t> flags, whites;
    std::size_t size;
    BankBlock block;
};

}  // namespace

TEST_CASE("baseline in double: mean and variance of a window far from zero, or behind a wild first sample") {
    for (double offset : {0.0, 4.5, -1e6}) {
        for (double first : {0.0, 1e3}) {
            std::vector<double> y = noise(500);
            long double sum = 0, squares = 0;
            for (double& one : y) one += offset;
            y[0] += first;
            engine::Baseline<double> window;
            for (double one : y) window.add(one), sum += one;
            const long double mean = sum / 500;
            for (double one : y) squares += (one - mean) * (one - mean);
            CHECK(window.samples() == 500);
            CHECK(!window.constant());
            // If the first sample is far from all others, the relative errors of mean and variance grow by a
            // factor that is at most the number of samples.
            const double digits = first == 0 ? 1e-14 : 1e-12;
            CHECK(window.bias() == doctest::Approx(static_cast<double>(mean)).epsilon(digits));
            CHECK(window.variance(0) ==
                  doctest::Approx(static_cast<double>(squares / 499)).epsilon(100 * digits));
            CHECK(window.variance(1e4) == 1e8 / 12);
        }
    }
    engine::Baseline<double> still;
    for (int k = 0; k < 1000; ++k) still.add(0.1);
    CHECK(still.constant());
    CHECK(still.bias() == 0.1);
}

TEST_CASE("supervisor: bytes that it cannot have come to are known") {
    engine::Supervisor<double> one;
    for (int k = 0; k < 500; ++k) {
        CHECK(one.plausible());
        CHECK(one.calm() == (k == 0));
        one.judge(1, 0, 0, k % 3 == 0);
    }
    unsigned char bytes[sizeof one];
    for (std::size_t i = 0; i < sizeof one; ++i) {
        std::memcpy(bytes, &one, sizeof one);
        bytes[i] = static_cast<unsigned char>(bytes[i] ^ 0x80);
        engine::Supervisor<double> other;
        std::memcpy(static_cast<void*>(&other), bytes, sizeof other);
        CHECK(!other.plausible());
    }
}

TEST_CASE("lanes: blocks of any size are the same, those that run away are told and begin again") {
    for (std::size_t lanes : {1u, 2u, 3u, 5u}) {
        for (int guard : {0, 2}) {
            const std::size_t rows = 300;
            const std::vector<double> y = noise(rows * lanes, guard == 0 ? 3 : 0.15);
            std::vector<std::uint8_t> missing(rows * lanes, 0);
            for (std::size_t i = 0; i < missing.size(); i += 7) missing[i] = 1;
            Room whole(rows, lanes), cut(rows, lanes);
            std::unique_ptr<LaneRunner> one = lanes_of(lanes, guard, 0.002),
                                        two = lanes_of(lanes, guard, 0.002);
            std::vector<Lost> first, second;
            one->run(y.data(), missing.data(), rows, whole.block.columns, whole.block.valid, first);
            for (std::size_t from = 0; from < rows;) {
                const std::size_t n = std::min<std::size_t>(from % 37 + 1, rows - from);
                const BankBlock out = cut.at(from, lanes);
                two->run(y.data() + from * lanes, missing.data() + from * lanes, n, out.columns, out.valid,
                         second, from);
                from += n;
            }
            CHECK(whole == cut);
            REQUIRE(first.size() == second.size());
            CHECK(one->restarts() == two->restarts());
            CHECK(first.empty() == (guard != 0));
            for (std::size_t i = 0; i < first.size(); ++i) {
                CHECK(first[i].row == second[i].row);
                CHECK(first[i].lane == second[i].lane);
                CHECK(whole.block.valid[first[i].row * lanes + first[i].lane] == 0);
                CHECK(std::isnan(whole.block.columns[kLaneAlpha][first[i].row * lanes + first[i].lane]));
            }
            CHECK(one->save() == two->save());
            CHECK(one->save_supervisors() == two->save_supervisors());
        }
    }
}

TEST_CASE("lanes: other settings in mid-run leave the memory and the other lanes alone") {
    for (const std::size_t lanes : {1u, 3u, 9u}) {
        const std::size_t rows = 120;
        const std::vector<double> y = noise(2 * rows * lanes);
        const auto run = [&](double last_R, bool told) {
            const std::unique_ptr<LaneRunner> runner = lanes_of(lanes, 2);
            std::vector<double> numbers(kLaneColumns * rows * lanes);
            std::vector<std::uint8_t> valid(rows * lanes);
            std::vector<Lost> lost;
            double* columns[kLaneColumns];
            for (std::size_t i = 0; i < kLaneColumns; ++i) columns[i] = numbers.data() + i * rows * lanes;
            runner->run(y.data(), nullptr, rows, columns, valid.data(), lost);
            std::vector<engine::LaneSettings> settings(lanes, kTriple);
            settings.back().R = last_R;
            if (told) runner->retune(settings.data());
            runner->run(y.data() + rows * lanes, nullptr, rows, columns, valid.data(), lost);
            return numbers;
        };
        const std::vector<double> plain = run(0.0235, false), same = run(0.0235, true),
                                  other = run(0.01, true);
        CHECK(std::memcmp(plain.data(), same.data(), plain.size() * sizeof(double)) == 0);
        for (std::size_t k = 0; k < rows * lanes; ++k) {
            const std::size_t at = kLaneX * rows * lanes + k;
            REQUIRE((plain[at] == other[at]) == (k % lanes != lanes - 1));
        }
    }
}

TEST_CASE("lanes: what is loaded goes on like what was saved, and nothing else is loaded") {
    const std::size_t lanes = 3, rows = 100;
    std::vector<double> y = noise(2 * rows * lanes);
    for (std::size_t i = 0; i < y.size(); i += 5) y[i] *= 30;
    std::unique_ptr<LaneRunner> one = lanes_of(lanes, 2), two = lanes_of(lanes, 2);
    Room before(rows, lanes), after(rows, lanes), again(rows, lanes);
    std::vector<Lost> lost;
    one->run(y.data(), nullptr, rows, before.block.columns, before.block.valid, lost);
    const std::vector<unsigned char> engine = one->save(), supervisors = one->save_supervisors();
    CHECK(!two->load(engine.data(), engine.size() - 1));
    CHECK(!two->load_supervisors(supervisors.data(), supervisors.size() - 1));
    const std::vector<unsigned char> wrong(engine.size(), 0xff);
    CHECK(!two->load(wrong.data(), wrong.size()));
    CHECK(!two->load_supervisors(wrong.data(), supervisors.size()));
    CHECK(two->load(engine.data(), engine.size()));
    CHECK(two->load_supervisors(supervisors.data(), supervisors.size()));
    one->run(y.data() + rows * lanes, nullptr, rows, after.block.columns, after.block.valid, lost);
    two->run(y.data() + rows * lanes, nullptr, rows, again.block.columns, again.block.valid, lost);
    CHECK(after == again);
}

TEST_CASE("bank: window, lanes and gaps in blocks of any size are the same") {
    for (std::size_t axes : {1u, 3u}) {
        const std::size_t rows = 2000, window = 50;
        std::vector<double> y = noise(rows * axes);
        const std::vector<double> bias(axes, 0.01);
        std::vector<std::uint8_t> live(axes, 1);
        if (axes > 1) live[1] = 0;
        Room rooms[] = {Room(rows, axes), Room(rows, axes)};
        for (std::size_t which = 0; which < 2; ++which) {
            AxisBank bank(axes);
            std::vector<Lost> lost;
            const auto run = [&](std::size_t from, std::size_t to) {
                while (from < to) {
                    const std::size_t n = which == 0 ? to - from : std::min(from % 200 + 1, to - from);
                    bank.run(y.data() + from * axes, n, rooms[which].at(from, axes), lost);
                    from += n;
                }
            };
            bank.skip(3, lost);
            run(0, window);
            CHECK(bank.window(0).samples() == window);
            bank.start(lanes_of(axes, 2), bias.data(), live.data());
            run(window, 700);
            bank.skip(300, lost);
            bank.know(std::vector<Known>(axes, Known{true, 0.5, 0.2, -1, 0.3}));
            run(700, rows);
            CHECK(bank.newest(0).alpha == rooms[which].block.columns[kLaneAlpha][(rows - 1) * axes]);
            CHECK(lost.empty());
            CHECK(std::isfinite(bank.whiteness(0).lag1()));
            CHECK(bank.whiteness(0).nis() > 0);
        }
        CHECK(rooms[0] == rooms[1]);
        for (std::size_t k = 0; k < rows * axes; ++k) {
            REQUIRE(rooms[0].block.valid[k] == (k >= window * axes && live[k % axes]));
            REQUIRE(std::isfinite(rooms[0].block.columns[kLaneX][k]) == (rooms[0].block.valid[k] == 1));
            if (k < 700 * axes || !live[k % axes]) continue;
            REQUIRE(rooms[0].block.columns[kLaneAlphaStd][k] >= 0.2);
            REQUIRE(rooms[0].block.columns[kLaneFStd][k] >= 0.3);
        }
    }
}
