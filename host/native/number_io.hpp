// Saves the state of an object as a row of doubles, and loads it again. Every loaded number is checked,
// because it may come from any file.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

namespace fltea {

class NumberSaver {
  public:
    enum { kLoads = 0 };
    explicit NumberSaver(std::vector<double>& out) : out_(out) {}
    bool sound() const { return true; }
    void require(bool) {}
    template <typename T>
    void number(const T& value, double, double) {
        out_.push_back(static_cast<double>(value));
    }
    template <typename T>
    void real(const T& value, double, double) {
        out_.push_back(static_cast<double>(value));
    }

  private:
    std::vector<double>& out_;
};

// Loads a number into `value`. If the number is not between `low` and `high`, leaves `value` unchanged.
class NumberLoader {
  public:
    enum { kLoads = 1 };
    NumberLoader(const double* from, const double* end) : from_(from), end_(end), sound_(true) {}
    bool sound() const { return sound_; }
    bool at_end() const { return from_ == end_; }
    std::size_t left() const { return static_cast<std::size_t>(end_ - from_); }
    void require(bool condition) {
        if (!condition) sound_ = false;
    }
    // Loads an integer into `value`.
    template <typename T>
    void number(T& value, double low, double high) {
        double got = 0;
        if (!next(got, low, high)) return;
        if (std::floor(got) != got) {
            sound_ = false;
            return;
        }
        value = static_cast<T>(got);
    }
    template <typename T>
    void real(T& value, double low, double high) {
        double got = 0;
        if (next(got, low, high)) value = static_cast<T>(got);
    }

  private:
    bool next(double& got, double low, double high) {
        if (sound_ && from_ != end_) {
            got = *from_++;
            if (got >= low && got <= high) return true;
        }
        sound_ = false;
        return false;
    }

    const double* from_;
    const double* end_;
    bool sound_;
};

}  // namespace fltea
