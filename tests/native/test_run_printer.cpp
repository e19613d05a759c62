// Tests under sanitizers how a run of a device's samples is printed. tests/sinks checks that the text is the
// same as for a block of the same samples, and the format of numbers. The tests here check accesses at the
// ends of columns and of buffers.
#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "run_printer.hpp"

using namespace fltea;

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
using Texts = std::vector<std::string>;
using Holes = std::vector<LinePrinter::Hole>;

// Stands in for a tracker and a bank of filters. The number of a column is part of each result that it makes
// up, so a test sees whether the printer took it from the right column. The bank's results for the second
// axis are NaN.
struct Numbered : TrackerPart, BankPart {
    void run(const double*, const double*, std::size_t, std::size_t rows, double* out, std::uint8_t* moving,
             std::vector<track::TrackerEvent>&) override {
        const std::size_t n = rows * axes;
        for (std::size_t c = 0; c < kTrackedColumns; ++c)
            for (std::size_t i = 0; i < n; ++i) out[c * n + i] = static_cast<double>(c) + 0.5;
        for (std::size_t i = 0; i < n; ++i) moving[i] = i % 2;
    }
    void skip_rows(std::uint64_t) override {}
    void run(const double*, std::size_t rows, const BankBlock& out, std::vector<Lost>&) override {
        const std::size_t n = rows * axes;
        for (std::size_t c = 0; c < kLaneColumns; ++c)
            for (std::size_t i = 0; i < n; ++i)
                out.columns[c][i] = i % axes ? kNan : static_cast<double>(10 * c);
        for (std::size_t i = 0; i < n; ++i) out.valid[i] = out.white[i] = 1 - i % 2;
    }
    void skip_rows(std::uint64_t, std::vector<Lost>&) override {}
    std::size_t axes = 2;
};

struct Walk {
    Device device;
    Numbered parts;
    std::vector<char> room;
    std::vector<std::int64_t> sequence, device_us, host_ns;
    std::vector<std::int16_t> gyro;
    std::size_t window = 0;

    // Processes the samples with numbers k from `first` to below `end`. The value on an axis is 10 k + axis.
    Advanced take(std::int64_t first, std::int64_t end) {
        sequence.clear();
        device_us.clear();
        host_ns.clear();
        gyro.clear();
        for (std::int64_t k = first; k < end; ++k) {
            sequence.push_back(k);
            device_us.push_back(k * 10'000);
            host_ns.push_back(k * 10'000'000);
            for (int axis = 0; axis < 3; ++axis) gyro.push_back(static_cast<std::int16_t>(10 * k + axis));
        }
        if (first == 0) {
            device.place.on_hello(100, 50, true, true);
            device.scales = {1, false, 0, 1, 0};
        }
        Advanced found = advance();
        if (found.stop != Stop::kEpoch) return found;
        Sensor one;
        one.places = {2, 0};
        one.tracker = &parts;
        one.bank = &parts;
        one.waits = {false, false};
        one.window_left = window;
        device.begin(0, {one});
        return advance();
    }
    Advanced advance() {
        const SampleColumns from = {sequence.size(),
                                    sequence.data(),
                                    device_us.data(),
                                    host_ns.data(),
                                    NumberColumn(gyro.data(), NumberColumn::kCounts, 3),
                                    {},
                                    {},
                                    nullptr};
        return device.advance(from, 0, [this](std::size_t bytes) {
            room = std::vector<char>(bytes);
            return room.data();
        });
    }
};

RunPrinter printer(Texts texts, Holes holes, std::int64_t every, fltea::RunShape shape, bool nulls = true) {
    const auto lines = std::make_shared<const LinePrinter>(std::move(texts), std::move(holes), nulls);
    return RunPrinter(lines, every, 2, std::move(shape));
}

std::string taken(RunPrinter& from) {
    const std::string found(from.data(), from.size());
    from.clear();
    return found;
}

}  // namespace

TEST_CASE("run printer: columns of samples, sensors and corrected rates, to the last one") {
    Walk walk;
    const Advanced found = walk.take(0, 3);
    RunPrinter one = printer({"", " ", " ", " ", " ", " ", " ", " ", " ", "\n"},
                             {{0, 0}, {3, 2}, {7, 0}, {7, 1}, {8, 1}, {13, 0}, {15, 1}, {20, 1}, {21, 0}}, 1,
                             {3, 0, 0, 0, 2, 0, 1});
    one.append(walk.device, found.begin, found.end);
    CHECK(one.records() == 6);
    CHECK(one.missed() == 0);
    CHECK(taken(one) ==
          "0 2.0 -0.5 -2.5 null 50.0 false 4.5 false\n"
          "1 12.0 9.5 7.5 null 50.0 false 4.5 false\n"
          "2 22.0 19.5 17.5 null 50.0 false 4.5 false\n");
    CHECK(taken(one).empty());
    CHECK(one.records() == 0);
}

TEST_CASE("run printer: while a window fills there are no columns of estimates") {
    Walk walk;
    walk.window = 5;
    const Advanced found = walk.take(0, 3);
    RunPrinter one =
        printer({"{\"a\":", ",\"m\":", "}"}, {{12, 1}, {13, 1}}, 1, {3, 0, 0, 0, 2, 0, 0}, false);
    one.append(walk.device, found.begin, found.end);
    CHECK(taken(one) == "{\"a\":4.5,\"m\":true}{\"a\":4.5,\"m\":true}{\"a\":4.5,\"m\":true}");
    RunPrinter other = printer({"", ""}, {{0, 0}}, 1, {3, 0, 0, 0, 2, 0, 1});
    other.append(walk.device, found.begin, found.end);
    CHECK(other.missed() == 3);
    CHECK(other.records() == 0);
    CHECK(taken(other).empty());
    CHECK(other.missed() == 0);
}

TEST_CASE("run printer: every n-th sample by its number, whatever the runs and what is given of them") {
    Walk walk;
    RunPrinter one = printer({"", " ", "\n"}, {{0, 0}, {7, 0}}, 4, {3, 0, 0, 0, 2, 0, 1});
    std::string all;
    std::int64_t first = 0;
    for (const std::int64_t size : {1, 2, 3, 1, 1, 1, 5, 3000, 2}) {
        walk.take(first, first + size);
        for (std::size_t row = 0; row < walk.device.run().n; row += 3)
            one.append(walk.device, row, std::min(row + 3, walk.device.run().n));
        first += static_cast<std::int64_t>(walk.device.run().n);
    }
    CHECK(first == 2048 + 16);  // of 3,000 samples, the run took what fits into it
    for (std::int64_t k = 0; k < first; k += 4)
        all += std::to_string(k) + " " + std::to_string(static_cast<std::int16_t>(10 * k + 2) - 3) + ".5\n";
    all.replace(0, 6, "0 -0.5");
    CHECK(one.records() == 2 * ((2048 + 16) / 4));
    CHECK(taken(one) == all);
    one.append(walk.device, 1, 1);
    RunPrinter rare =
        printer({"", "\n"}, {{0, 0}}, std::numeric_limits<std::int64_t>::max(), {3, 0, 0, 0, 2, 0, 1});
    rare.append(walk.device, 0, walk.device.run().n);
    CHECK(one.size() + rare.size() + rare.missed() == 0);
}

TEST_CASE("line printer: what is not finite is left out with its key, or null") {
    const std::vector<double> values = {1, kNan, 1e300, -INFINITY, -1e-300, 5e-324};
    const Cells column = {values.data(), 16, 8, Cells::kReal};
    const Texts texts = {"{\"a\":", ",\"b\":", "}"};
    for (const bool nulls : {true, false}) {
        const LinePrinter one(texts, {{0, 0}, {0, 1}}, nulls);
        std::vector<char> room(one.room(3));
        const std::string found(room.data(), one.print(&column, 0, 3, 1, room.data()));
        CHECK(found == (nulls ? "{\"a\":1.0,\"b\":null}{\"a\":1e300,\"b\":null}{\"a\":-1e-300,\"b\":5e-324}"
                              : "{\"a\":1.0}{\"a\":1e300}{\"a\":-1e-300,\"b\":5e-324}"));
    }
    CHECK_THROWS_AS(LinePrinter({"a"}, {{0, 0}}, true), std::invalid_argument);
}
