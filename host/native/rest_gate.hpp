// Whether a sensor is at rest, by the innovations of its filter. The rules are those of the gate of the live
// fit (firmware/core/engine/gate.hpp), on shorter chunks and with what the filter knows of the noise.
//
// A chunk of 32 is a knock if the power of its innovations, the largest not counted, is sixteen times that of
// the noise, if one of them alone is a hundred deviations away, or if their mean is eight of its deviations
// away. Rest is back after two chunks that are none. After 32 chunks in a row that lie still elsewhere, there
// is where the offset is now.
//
// The filter leaves lines and more that is no motion to its innovations. Where those at rest are larger than
// they should be, or their means are, that is what others are beside.
#pragma once

#include <cmath>

namespace fltea {
namespace track {

// Powers of a chunk's innovations, and of their mean, over those of the noise; never less than 1.
struct Usual {
    double power = 1, mean = 1;
};

class RestGate {
  public:
    enum { kChunk = 32, kQuiet = 2, kStill = 32 };
    enum Verdict { kGoesOn, kBegins, kEnds, kElsewhere };
    static constexpr double kKnock = 16, kSpike = 100, kMean = 8;

    explicit RestGate(const Usual& usual = Usual()) : usual_(usual) {}

    const Usual& usual() const { return usual_; }
    void expect(const Usual& usual) { usual_ = usual; }
    bool moving() const { return moving_; }
    int fill() const { return fill_; }

    // An innovation in its deviations; y: the sample, deviation: of the noise of one. True if it is one of
    // motion by itself.
    bool add(double z, double y, double deviation) {
        z = bounded(z);
        const double power = z * z;
        sum_ += z;
        powers_ += power;
        if (power > largest_) largest_ = power;
        if (known_ == 0) first_ = y;
        const double apart = bounded((y - first_) / deviation);
        own_ += apart;
        own_powers_ += apart * apart;
        ++known_;
        return power > kSpike * kSpike * usual_.power;
    }

    // After each sample, which may be missing.
    Verdict next(double deviation) {
        if (++fill_ < kChunk) return kGoesOn;
        const int n = known_;
        const double most = kKnock * usual_.power * (n - 1), apart = kMean * std::sqrt(usual_.mean);
        const bool knock = n > 1 && (powers_ - largest_ > most || largest_ > kSpike * kSpike * usual_.power ||
                                     std::fabs(sum_) > apart * std::sqrt(double(n)));
        const double mean = n > 0 ? own_ / n : 0;
        const bool still = n > 1 && own_powers_ - mean * own_ < most;
        const double place = first_ + mean * deviation;
        const bool same =
            still && has_place_ && std::fabs(place - place_) < apart * deviation * std::sqrt(2.0 / kChunk);
        place_ = place;
        has_place_ = still;
        stood_ = moving_ && same ? stood_ + 1 : 0;
        quiet_ = knock ? 0 : quiet_ + 1;
        clear_chunk();
        if (!moving_) {
            moving_ = knock;
            return knock ? kBegins : kGoesOn;
        }
        if (quiet_ >= kQuiet) {
            moving_ = false;
            return kEnds;
        }
        if (stood_ < kStill) return kGoesOn;
        moving_ = false;
        stood_ = 0;
        return kElsewhere;
    }

    template <typename Io>
    void visit(Io& io) {
        io.number(fill_, 0, kChunk - 1);
        io.number(known_, 0, fill_);
        io.number(quiet_, 0, 1e15);
        io.number(stood_, 0, kStill);
        io.number(moving_, 0, 1);
        io.number(has_place_, 0, 1);
        io.real(sum_, -1e300, 1e300);
        io.real(powers_, 0, 1e300);
        io.real(largest_, 0, 1e300);
        io.real(own_, -1e300, 1e300);
        io.real(own_powers_, 0, 1e300);
        io.real(first_, -1e150, 1e150);
        io.real(place_, -1e300, 1e300);
        io.real(usual_.power, 1, 1e300);
        io.real(usual_.mean, 1, 1e300);
    }

  private:
    // Whose square is a number.
    static double bounded(double x) { return x > 1e100 ? 1e100 : x < -1e100 ? -1e100 : x; }

    void clear_chunk() {
        fill_ = known_ = 0;
        sum_ = powers_ = largest_ = own_ = own_powers_ = 0;
    }

    Usual usual_;
    int fill_ = 0, known_ = 0, stood_ = 0;
    long long quiet_ = 0;
    bool moving_ = false, has_place_ = false;
    double sum_ = 0, powers_ = 0, largest_ = 0, own_ = 0, own_powers_ = 0, first_ = 0, place_ = 0;
};

}  // namespace track
}  // namespace fltea
