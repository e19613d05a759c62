// The engine's memories of past states behind a C interface, for tests and benchmarks in Python. A shared
// library is built for each instruction set. Each library has the memories for all number types.
#include <stdlib.h>

#include <chrono>
#include <cstring>
#include <new>

#include "memory_compressed.hpp"
#include "memory_direct.hpp"
#include "pack_math.hpp"

namespace {

using namespace fltea::engine;
typedef Pack<double, kWidth> Wide;

struct Probe {
    virtual ~Probe() {}
    virtual int lanes() const = 0;
    virtual void reset() = 0;
    virtual void push(std::size_t n, const double* x, const double* P) = 0;
    virtual void evaluate(const double* orders, double* S, double* V) const = 0;
    virtual void sums(const double* order, double* S, double* V) const = 0;
    virtual void stir(std::size_t n, std::uint64_t seed) = 0;
    virtual std::size_t bytes() const = 0;
    virtual double seconds(std::size_t n) = 0;
    virtual void nodes(double* out) const = 0;
};

template <class T>
T load(const double* lanes) {
    T number = T(Real<T>(0));
    for (int lane = 0; lane < Lanes<T>::count; ++lane) set_lane(number, lane, Real<T>(lanes[lane]));
    return number;
}
template <class T>
void store(T number, double* lanes) {
    for (int lane = 0; lane < Lanes<T>::count; ++lane) lanes[lane] = double(get_lane(number, lane));
}

void describe(const void*, double*) {}
template <class T>
void describe(const CompressedMemory<T>* memory, double* out) {
    out[0] = double(memory->nodes().state.count);
    out[1] = double(memory->nodes().variance.count);
    out[2] = memory->nodes().step;
}

template <class T, class Memory>
class Holder : public Probe {
    static constexpr int kLanes = Lanes<T>::count;

  public:
    // Allocates exactly as many bytes as the memory of past states needs, so that a sanitizer detects an
    // access beyond these bytes.
    template <class... Setup>
    explicit Holder(std::size_t n, Setup... setup)
        : bytes_(n * sizeof(T)), storage_(allocate(bytes_)), memory_(storage_, setup...) {}
    ~Holder() override { free(storage_); }

    int lanes() const override { return kLanes; }
    void reset() override { memory_.reset(); }

    void push(std::size_t n, const double* x, const double* P) override {
        const T zero = T(Real<T>(0));
        for (std::size_t k = 0; k < n; ++k) {
            memory_.push(x ? load<T>(x + k * kLanes) : zero, P ? load<T>(P + k * kLanes) : zero);
        }
    }
    // Computes weighted sums over past samples for each lane (axis): `S`, the sum of the states, for each of
    // three orders, and `V`, the sum of the variances, for the first order only.
    void evaluate(const double* orders, double* S, double* V) const override {
        T order[3], state[3];
        for (int i = 0; i < 3; ++i) order[i] = load<T>(orders + i * kLanes);
        memory_.state_sums(order, state);
        for (int i = 0; i < 3; ++i) store(state[i], S + i * kLanes);
        store(memory_.variance_sum(order[0]), V);
    }
    void sums(const double* order, double* S, double* V) const override {
        T state, variance;
        memory_.sums(load<T>(order), state, variance);
        store(state, S);
        store(variance, V);
    }
    // Adds n random pasts to the memory: a state, roughly normal with variance 1, and the variance of its
    // error, around 1. They are the same in all lanes (axes).
    void stir(std::size_t n, std::uint64_t seed) override {
        for (std::size_t k = 0; k < n; ++k) {
            double sum = 0;
            for (int i = 0; i < 3; ++i) {
                seed = seed * 6364136223846793005u + 1442695040888963407u;
                sum += double(seed >> 11) / 9007199254740992.0 - 0.5;
            }
            memory_.push(T(Real<T>(2 * sum)), T(Real<T>(1 + sum / 3)));
        }
    }
    std::size_t bytes() const override { return bytes_ + sizeof(typename Memory::Position); }
    // Measures the time that the memory of past states takes in n steps of the estimator, for tools/bench. As
    // in the estimator, each step depends on the result of the step before.
    double seconds(std::size_t n) override {
        T order[3] = {T(Real<T>(0.3)), T(Real<T>(0.5)), T(Real<T>(0.1))}, S[3], past, V;
        const T small = T(Real<T>(1e-9));
        const std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
        for (std::size_t k = 0; k < n; ++k) {
            memory_.state_sums(order, S);
            memory_.sums(order[0] + S[1] * small, past, V);
            memory_.push(past * small + T(Real<T>(k % 7)), V * small + T(Real<T>(1)));
            order[0] = order[0] + past * small;
        }
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    }
    void nodes(double* out) const override { describe(&memory_, out); }

  private:
    static T* allocate(std::size_t n) {
        void* block = nullptr;
        if (posix_memalign(&block, 64, n) != 0) abort();
        memset(block, 0xa5, n);
        return static_cast<T*>(block);
    }

    std::size_t bytes_;
    T* storage_;
    Memory memory_;
};

template <class T>
Probe* make(int digits, std::size_t window) {
    if (digits < 0) return new Holder<T, DirectMemory<T>>(DirectMemory<T>::storage(window), window);
    const CompressedConfig config = compressed_config(window, digits);
    return new Holder<T, CompressedMemory<T>>(CompressedMemory<T>::storage(config), config);
}

template <class T>
void tabulate(std::size_t n, const double* x, double* up, double* down, double* sine) {
    const std::size_t lanes = Lanes<T>::count;
    for (std::size_t i = 0; i + lanes <= n; i += lanes) {
        const Powers<T> powers = exp_both(load<T>(x + i));
        store(powers.up, up + i);
        store(powers.down, down + i);
        store(sin_pi(load<T>(x + i)), sine + i);
    }
}

}  // namespace

extern "C" {
// `type`: 'f' is float, 'd' is double, and 'w' is a pack as wide as the registers. `digits`: number of
// accurate digits of a compressed memory; a negative number selects the direct memory, which keeps all past
// states.
Probe* probe_make(char type, int digits, std::size_t window) {
    return type == 'f'   ? make<float>(digits, window)
           : type == 'd' ? make<double>(digits, window)
                         : make<Wide>(digits, window);
}
void probe_free(Probe* probe) { delete probe; }
int probe_lanes(const Probe* probe) { return probe->lanes(); }
void probe_reset(Probe* probe) { probe->reset(); }
void probe_push(Probe* probe, std::size_t n, const double* x, const double* P) { probe->push(n, x, P); }
void probe_evaluate(const Probe* probe, const double* orders, double* S, double* V) {
    probe->evaluate(orders, S, V);
}
void probe_sums(const Probe* probe, const double* order, double* S, double* V) { probe->sums(order, S, V); }
void probe_stir(Probe* probe, std::size_t n, std::uint64_t seed) { probe->stir(n, seed); }
std::size_t probe_bytes(const Probe* probe) { return probe->bytes(); }
double probe_seconds(Probe* probe, std::size_t n) { return probe->seconds(n); }
void probe_nodes(const Probe* probe, double* out) { probe->nodes(out); }
void probe_math(char type, std::size_t n, const double* x, double* up, double* down, double* sine) {
    type == 'f'   ? tabulate<float>(n, x, up, down, sine)
    : type == 'd' ? tabulate<double>(n, x, up, down, sine)
                  : tabulate<Wide>(n, x, up, down, sine);
}
}
