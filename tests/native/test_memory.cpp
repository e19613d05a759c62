// Tests of the memories of past states, which compute the weighted sums of past states in the fractional
// difference. A memory has to stay inside the storage that it requests. Its sums have to agree with sums
// whose weights are computed one after another, by the recurrence of the binomial coefficients.
#include <doctest/doctest.h>
#include <stdlib.h>

#include <cmath>
#include <initializer_list>
#include <vector>

#include "memory_compressed.hpp"
#include "memory_direct.hpp"

namespace {

using fltea::engine::CompressedMemory;
using fltea::engine::DirectMemory;
typedef fltea::engine::Pack<double, fltea::engine::kWidth> Wide;

// Storage of exactly n elements, so that the sanitizer detects an access beyond it. The storage is filled
// with NaN.
template <class T>
class Block {
  public:
    explicit Block(std::size_t n) : data_(nullptr) {
        REQUIRE(posix_memalign(&data_, 64, n * sizeof(T)) == 0);
        std::memset(data_, 0xff, n * sizeof(T));
    }
    ~Block() { free(data_); }
    Block(const Block&) = delete;
    Block& operator=(const Block&) = delete;
    T* data() const { return static_cast<T*>(data_); }

  private:
    void* data_;
};

double x_at(std::size_t k) { return std::sin(double(k * k)); }
double P_at(std::size_t k) { return 1.5 + std::cos(double(k)); }

// Computes the sums S (of states, with weights c) and V (of their variances, with weights c²) over the
// samples 0 .. k-1 by their definition. The weights for the order a are binomial coefficients. Sample k-1 is
// the newest.
void exact(double a, std::size_t k, std::size_t window, double& S, double& V) {
    const std::size_t length = window > 0 && window < k ? window : k;
    double c = 1;
    S = V = 0;
    for (std::size_t j = 1; j <= length; ++j) {
        c *= (double(j) - 1 - a) / double(j);
        S += c * x_at(k - j);
        if (j > 1) V += c * c * P_at(k - j);
    }
}

template <class T>
double in(T number, int lane) {
    return double(fltea::engine::get_lane(number, lane));
}

// Adds samples to a memory, and compares its sums with those of exact() at every step. `tolerance` is
// relative to 1 + |sum|.
template <class T, class Memory>
void follow(Memory& memory, std::size_t window, std::size_t steps, double tolerance) {
    typedef fltea::engine::Real<T> R;
    const double orders[3] = {0.3, -0.45, 1.7};
    for (std::size_t k = 0; k <= steps; ++k) {
        T order[3], S[3], s, v;
        for (int i = 0; i < 3; ++i) order[i] = T(R(orders[i]));
        memory.state_sums(order, S);
        for (int i = 0; i < 3; ++i) {
            double expected_S, expected_V;
            exact(double(R(orders[i])), k, window, expected_S, expected_V);
            memory.sums(order[i], s, v);
            const int last = fltea::engine::Lanes<T>::count - 1;
            for (int lane : {0, last}) {
                REQUIRE(std::fabs(in(S[i], lane) - expected_S) <= tolerance * (1 + std::fabs(expected_S)));
                REQUIRE(std::fabs(in(s, lane) - expected_S) <= tolerance * (1 + std::fabs(expected_S)));
                REQUIRE(std::fabs(in(v, lane) - expected_V) <= tolerance * (1 + expected_V));
                REQUIRE(in(memory.variance_sum(order[i]), lane) == in(v, lane));
            }
        }
        memory.push(T(R(x_at(k))), T(R(P_at(k))));
    }
}

}  // namespace

TEST_CASE_TEMPLATE("direct", T, float, double, Wide) {
    const double tolerance = sizeof(fltea::engine::Real<T>) == 4 ? 3e-6 : 1e-14;
    for (std::size_t window : {1u, 2u, 3u, 7u, 8u, 9u, 10u, 11u, 40u}) {
        Block<T> block(DirectMemory<T>::storage(window));
        DirectMemory<T> memory(block.data(), window);
        follow<T>(memory, window, 3 * window + 2, tolerance);
        memory.reset();
        follow<T>(memory, window, window + 1, tolerance);
    }
}

TEST_CASE_TEMPLATE("compressed", T, float, double, Wide) {
    const double tolerance = sizeof(fltea::engine::Real<T>) == 4 ? 1e-5 : 1e-7;
    for (std::size_t window : {0u, 1u, 2u, 3u, 14u, 15u, 16u, 17u, 40u, 300u}) {
        const fltea::engine::CompressedConfig config = fltea::engine::compressed_config(window, 7);
        Block<T> block(CompressedMemory<T>::storage(config));
        CompressedMemory<T> memory(block.data(), config);
        follow<T>(memory, window, window < 100 ? 120 : 700, tolerance);
        memory.reset();
        follow<T>(memory, window, 20, tolerance);
    }
}

TEST_CASE("settings out of range count as the nearest") {
    CHECK(fltea::engine::compressed_config(0, 0).digits == fltea::engine::kDefaultDigits);
    CHECK(fltea::engine::compressed_config(0, -5).digits == fltea::engine::kLeastDigits);
    CHECK(fltea::engine::compressed_config(0, 99).digits == fltea::engine::kMostDigits);
}
