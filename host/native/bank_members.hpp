// The noise models of the bank of filters that a tracker uses before the first fit (walk_bank.hpp). All
// variances are relative to the variance of the white noise.
#pragma once

#include <complex>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>

#include "kalman.hpp"
#include "mean_ahead.hpp"

namespace fltea {
namespace track {

class BankMembers {
  public:
    // kMost: largest number of states of a model. kRoom: largest number of models.
    enum { kMost = 4, kRoom = 320 };
    typedef Kalman<kMost> Filter;

    // Returns the noise models of the bank. In them, the bias is the expected mean over the next `ahead`
    // samples. `ahead` is rounded to 3 %, so that sensors of similar rate share the models.
    static const BankMembers& of(std::int64_t ahead) {
        static std::mutex alone;
        static std::map<std::int64_t, std::unique_ptr<const BankMembers>> known;
        std::int64_t unit = 1;
        while (ahead / unit >= 64) unit *= 2;
        const std::int64_t rounded = (ahead + unit / 2) / unit * unit;
        const std::lock_guard<std::mutex> guard(alone);
        std::unique_ptr<const BankMembers>& one = known[rounded];
        if (one == nullptr) one.reset(new BankMembers(rounded));
        return *one;
    }

    int count() const { return count_; }
    const System<kMost>& system(int i) const { return systems_[i]; }
    const RiccatiMap<kMost>& map(int i) const { return maps_[i]; }
    const Filter::Gains& gains(int i) const { return gains_[i]; }

  private:
    // One noise model is the sum of three components. The first is white noise; if `corner` is not 0, it has
    // passed a low-pass of a pole pair with the corner frequency `corner` [rad/sample]. The second is an
    // offset that does a random walk with steps of variance q. The third is `n` relaxations (first-order
    // Gauss-Markov processes) with the time constants `times` [samples] and the variances `powers`.
    struct Noise {
        double corner, q;
        int n;
        double times[3], powers[3];
    };

    explicit BankMembers(std::int64_t ahead) : ahead_(ahead) {
        const double walks[] = {0,    1e-8, 1e-7, 3e-7, 1e-6, 3e-6, 1e-5, 3e-5,
                                1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1,  0.3};
        for (double q : walks) add(Noise{0, q, 0, {}, {}});
        for (double time : {1.5, 3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 200.0, 400.0}) {
            for (double power : {0.03, 0.1, 0.3, 1.0, 3.0, 10.0}) add(Noise{0, 0, 1, {time}, {power}});
        }
        for (double time : {2.0, 8.0, 30.0}) {
            for (double power : {0.1, 1.0, 10.0}) {
                for (double q : {1e-6, 1e-4}) add(Noise{0, q, 1, {time}, {power}});
            }
        }
        // Each of the next models has three relaxations. Its spectrum is similar to that of 1/f noise between
        // the shortest and the longest of their time constants, which are one or two decades apart.
        for (double time : {0.4, 1.0, 4.0}) {
            for (double apart : {4.0, 10.0}) {
                for (double tilt : {0.5, 1.0, 3.0}) {
                    for (double power : {0.03, 0.1, 0.3, 1.0, 3.0}) {
                        const double slower = time * apart;
                        add(Noise{
                            0, 0, 3, {time, slower, slower * apart}, {power * tilt, power, power / tilt}});
                    }
                }
            }
        }
        for (double corner : {0.3, 0.6, 1.2, 2.0}) {
            for (double q : {0.0, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2}) add(Noise{corner, q, 0, {}, {}});
            for (double time : {15.0, 30.0, 60.0, 120.0, 240.0}) {
                for (double power : {0.03, 0.1, 0.3, 1.0, 3.0}) add(Noise{corner, 0, 1, {time}, {power}});
            }
        }
        // In memory, the gains of all models for one sample lie next to each other, because each sample is
        // filtered with all models.
        const std::size_t stride = std::size_t(count_);
        of_samples_.reset(new Filter::Gain[stride * Filter::kExact]);
        for (int i = 0; i < count_; ++i) {
            gains_[i].stride = stride;
            Filter::find_gains(systems_[i], maps_[i], of_samples_.get() + i, gains_[i]);
        }
    }

    void add(const Noise& noise) {
        System<kMost>& s = systems_[count_];
        s = System<kMost>();
        s.pairs = noise.corner > 0 ? 1 : 0;
        s.n = 2 * s.pairs + 1 + noise.n;
        s.R = s.pairs == 0 ? 1 : kBehindFilter;
        if (s.pairs > 0) low_pass(noise.corner, s);
        const int offset = 2 * s.pairs;
        double power = 1;
        for (int k = 0; k < noise.n; ++k) {
            const int i = offset + 1 + k;
            s.a[i] = std::exp(-1 / noise.times[k]);
            s.P0[i * s.n + i] = noise.powers[k];
            s.Q[i * s.n + i] = noise.powers[k] * (1 - s.a[i] * s.a[i]);
            power += noise.powers[k];
        }
        s.a[offset] = 1;
        s.Q[offset * s.n + offset] = noise.q;
        s.P0[offset * s.n + offset] = 1e4 * power;
        for (int i = offset; i < s.n; ++i) s.c[i] = s.bias[i] = 1;
        const MeanAhead<kMost> mean = mean_ahead(s, s.bias, ahead_);
        std::memcpy(s.bias, mean.row, sizeof s.bias);
        s.bias_more = mean.variance;
        maps_[count_++].set(s);
    }

    // Sets the first two states of a system so that they describe white noise of variance 1 that has passed a
    // low-pass with a pair of poles, as in host/fltea/noise/system.py.
    static void low_pass(double corner, System<kMost>& s) {
        typedef std::complex<double> Complex;
        const Complex z = std::exp(corner * std::polar(1.0, 2.356194490192345)), m = z / (z - std::conj(z));
        const double hermitian = std::norm(m) / (1 - std::norm(z));
        const Complex plain = m * m / (1.0 - z * z);
        const double level = 1 / (hermitian + plain.real());
        covariance(level * hermitian, level * plain, s.n, s.P0);
        covariance(level * std::norm(m), level * m * m, s.n, s.Q);
        s.a[0] = s.a[1] = z.real();
        s.b[0] = s.b[1] = -z.imag();
        s.c[0] = 1;
    }

    // Writes the covariance matrix of the real and the imaginary part of a complex state ξ. `hermitian`: half
    // of the expected value of |ξ|². `plain`: half of that of ξ².
    static void covariance(double hermitian, std::complex<double> plain, int n, double* to) {
        to[0] = hermitian + plain.real();
        to[n + 1] = hermitian - plain.real();
        to[1] = to[n] = plain.imag();
    }

    static constexpr double kBehindFilter = 1e-3;

    std::int64_t ahead_;
    int count_ = 0;
    System<kMost> systems_[kRoom];
    RiccatiMap<kMost> maps_[kRoom];
    Filter::Gains gains_[kRoom];
    std::unique_ptr<Filter::Gain[]> of_samples_;
};

}  // namespace track
}  // namespace fltea
