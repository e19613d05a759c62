// Runs the board's running spectrum, fit and tracked state of one axis on noise that this program generates.
// On the emulated Due it counts instructions; on a PC it must give bitwise the same results. spectrum_cost.py
// builds it and defines SAMPLES and NOISE, a value of Kind. All noise is computed in integers.
#include <stdint.h>

#include <new>

#include "fit_bins.hpp"
#include "sensor_motion.hpp"
#include "sliced_fit.hpp"

namespace {

typedef fltea::engine::CountOctaves<> Octaves;
typedef fltea::engine::FitBins<Octaves> Bins;
typedef fltea::whittle::SlicedFit<Bins> Fit;
typedef fltea::whittle::FitMemory Memory;

enum Phase { kSample, kLevel, kBins, kColdFit, kWarmFit, kDesign, kTrack, kPhases };

struct Results {
    uint32_t done;
    uint32_t hash;  // hash of all results: spectral sums, bins, fit and tracker
    float alpha, alpha_std, ratio_white, ratio_ar1;
    uint32_t verdict, evaluations_cold, evaluations_warm, bins, depth;
    uint32_t octaves_bytes, bins_bytes, fit_bytes, memory_bytes, tracked_bytes;
    uint32_t calls[kPhases], instructions[kPhases], longest[kPhases];
};

Results results;
volatile uint32_t seed = 12345;
alignas(8) unsigned char octaves_storage[sizeof(Octaves)];
alignas(8) unsigned char bins_storage[sizeof(Bins)];
alignas(8) unsigned char fit_storage[sizeof(Fit)];
alignas(8) unsigned char memory_storage[sizeof(Memory)];
alignas(8) unsigned char design_storage[sizeof(fltea::whittle::FilterDesign)];
alignas(8) unsigned char tracked_storage[sizeof(fltea::whittle::TrackedState)];

#if defined(__arm__)
volatile uint32_t& at(uint32_t address) { return *reinterpret_cast<volatile uint32_t*>(address); }
// Returns a count that rises by one with each instruction, modulo 2^24. The timer SysTick counts the clock's
// cycles down, and in the emulator each instruction takes one cycle.
uint32_t now() { return 0xFFFFFF - at(0xE000E018); }
void start_counting() {
    at(0x400E1A54) = 1 << 15;  // this value turns the watchdog off
    at(0xE000E014) = 0xFFFFFF;
    at(0xE000E018) = 0;
    at(0xE000E010) = 5;
}
#else
uint32_t now() { return 0; }
void start_counting() {}
#endif

void count(Phase phase, uint32_t begun) {
    const uint32_t took = (now() - begun) & 0xFFFFFF;
    ++results.calls[phase];
    results.instructions[phase] += took;
    if (took > results.longest[phase]) results.longest[phase] = took;
}

void mix(uint32_t word) {
    results.hash = (results.hash ^ word) * 16777619u;
    results.hash ^= results.hash >> 15;
}
void mix(float number) {
    uint32_t bits;
    __builtin_memcpy(&bits, &number, sizeof bits);
    mix(bits);
}

enum Kind { kSlow, kWhite, kFast, kFullScale, kConstant };

class Noise {
  public:
    int16_t operator()() {
        switch (NOISE) {
            case kWhite:
                return static_cast<int16_t>(white() >> 6);
            case kFast:  // a relaxation within a few samples, and hardly any white noise
                slow_[0] += (white() * 1024 - slow_[0]) >> 2;
                return static_cast<int16_t>((white() * 16 + slow_[0]) >> 12);
            case kFullScale:
                return white() > 0 ? 32767 : -32768;
            case kConstant:
                return -7;
            default:  // white noise of about four counts and two slow relaxations
                for (int k = 0; k < 2; ++k) slow_[k] += (white() * (k + 3) * 64 - slow_[k]) >> (3 + 3 * k);
                return static_cast<int16_t>((white() * 64 + slow_[0] + slow_[1]) >> 12);
        }
    }

  private:
    int32_t white() {
        int32_t sum = -4 * 128;
        for (int k = 0; k < 4; ++k) {
            state_ = state_ * 1664525u + 1013904223u;
            sum += static_cast<int32_t>(state_ >> 24);
        }
        return sum;
    }
    uint32_t state_ = seed;
    int32_t slow_[2] = {0, 0};
};

void fit_once(const Bins& bins, Fit& fit, Memory& memory, Phase phase) {
    fit.begin(bins, fltea::whittle::kFivePercent, memory);
    for (bool done = false; !done;) {
        const uint32_t begun = now();
        done = fit.work(bins);
        count(phase, begun);
    }
}

// Tracks the bias of 1,200 samples of the fitted noise. After every 300 samples the tracker gets another
// Kalman filter: first that of the fit's noise model, then that of a fractional noise, then the first again.
void track(const fltea::whittle::FitFigures& found) {
    fltea::whittle::FilterDesign& design = *new (design_storage) fltea::whittle::FilterDesign;
    fltea::whittle::TrackedState& tracked = *new (tracked_storage) fltea::whittle::TrackedState;
    fltea::whittle::FitFigures order = fltea::whittle::FitFigures();
    order.verdict = fltea::whittle::Verdict::fractional;
    order.alpha = 0.7f, order.g = -0.08f, order.s2 = 4.0f, order.R = 12.0f;
    const fltea::whittle::FitFigures* const figures[] = {&found, &order, &found};
    fltea::whittle::TrackedState* const axes[] = {&tracked};
    fltea::whittle::SensorMotion motion;
    const fltea::whittle::SensorMotion::Limits limits = {32.8f, 31, 1875};
    Noise noise;
    for (int k = 0; k < 1200; ++k) {
        if (k % 300 == 0 && k > 0) {
            design.begin(*figures[k / 300 - 1], 100);
            for (bool done = false; !done;) {
                const uint32_t begun = now();
                done = design.work();
                count(kDesign, begun);
            }
            tracked.set(design.filter());
            tracked.skip(3);
        }
        const int16_t sample = noise();
        const uint32_t begun = now();
        tracked.next(sample, motion.moving());
        motion.next(axes, 1, limits);
        count(kTrack, begun);
        if (k % 10 != 0 || !tracked.known()) continue;
        const fltea::whittle::TrackedState::Figures now_known = tracked.figures(motion.unlearned());
        mix(now_known.bias);
        mix(now_known.bias_std);
        mix(now_known.state);
        mix(now_known.state_std);
    }
}

void run() {
    Octaves& octaves = *new (octaves_storage) Octaves;
    Bins& bins = *new (bins_storage) Bins;
    Fit& fit = *new (fit_storage) Fit;
    Memory& memory = *new (memory_storage) Memory;
    Octaves::Passage passage;
    Noise noise;
    for (int k = 0; k < SAMPLES; ++k) {
        const int16_t sample = noise();
        if (k == SAMPLES / 3) octaves.skip(3);
        if (k == SAMPLES / 2) octaves.skip(300);
        uint32_t begun = now();
        octaves.add(sample, passage);
        count(kSample, begun);
        for (bool passed = passage.n == 0 && !passage.cut; !passed;) {
            begun = now();
            passed = octaves.pass(passage);
            count(kLevel, begun);
        }
    }
    bins.begin();
    for (bool done = false; !done;) {
        const uint32_t begun = now();
        done = bins.step(octaves);
        count(kBins, begun);
    }
    fit_once(bins, fit, memory, kColdFit);
    results.evaluations_cold = static_cast<uint32_t>(fit.evaluations());
    fit_once(bins, fit, memory, kWarmFit);
    results.evaluations_warm = static_cast<uint32_t>(fit.evaluations());
    for (int level = 0; level < octaves.ladder().depth(); ++level) {
        float power[Octaves::Ladder::kTopLines], blocks, effective;
        octaves.ladder().sums(level, 0, power, &blocks, &effective);
        for (int i = 0; i < octaves.ladder().lines(level); ++i) mix(power[i]);
        mix(blocks);
    }
    for (int i = 0; i < bins.size(); ++i) {
        mix(bins.lam(i));
        mix(bins.counts(i));
        mix(bins.power(i));
    }
    const fltea::whittle::FitFigures& figures = memory.figures();
    const float told[] = {figures.alpha, figures.alpha_std, figures.g, figures.s2, figures.R};
    for (float one : told) mix(one);
    if (figures.verdict != fltea::whittle::Verdict::none) track(figures);
    results.alpha = figures.alpha;
    results.alpha_std = figures.alpha_std;
    results.ratio_white = figures.ratio_white;
    results.ratio_ar1 = figures.ratio_ar1;
    results.verdict = static_cast<uint32_t>(figures.verdict);
    results.bins = static_cast<uint32_t>(bins.size());
    results.depth = static_cast<uint32_t>(octaves.ladder().depth());
    results.octaves_bytes = sizeof(Octaves);
    results.bins_bytes = sizeof(Bins);
    results.fit_bytes = sizeof(Fit);
    results.memory_bytes = sizeof(Memory);
    results.tracked_bytes = sizeof(fltea::whittle::TrackedState);
    results.done = 1;
}

}  // namespace

#if defined(__arm__)
extern uint32_t bss_begin, bss_end, data_begin, data_end, data_load, stack_end;

extern "C" {
void* memset(void* to, int value, unsigned n) {
    unsigned char* at = static_cast<unsigned char*>(to);
    while (n-- > 0) *at++ = static_cast<unsigned char>(value);
    return to;
}
void* memcpy(void* to, const void* from, unsigned n) {
    unsigned char* at = static_cast<unsigned char*>(to);
    const unsigned char* source = static_cast<const unsigned char*>(from);
    while (n-- > 0) *at++ = *source++;
    return to;
}
void* memmove(void* to, const void* from, unsigned n) {
    if (to <= from) return memcpy(to, from, n);
    while (n-- > 0) static_cast<unsigned char*>(to)[n] = static_cast<const unsigned char*>(from)[n];
    return to;
}
const void* results_at() { return &results; }
[[noreturn]] void reset() {
    for (uint32_t* word = &bss_begin; word != &bss_end;) *word++ = 0;
    const uint32_t* image = &data_load;
    for (uint32_t* word = &data_begin; word != &data_end;) *word++ = *image++;
    start_counting();
    run();
    for (;;) __asm__ volatile("wfi");
}
}
__attribute__((section(".vectors"), used))
const void* const vectors[] = {&stack_end, reinterpret_cast<void*>(reset)};
#else
#include <stdio.h>
int main() {
    start_counting();
    run();
    return fwrite(&results, sizeof results, 1, stdout) == 1 ? 0 : 1;
}
#endif
