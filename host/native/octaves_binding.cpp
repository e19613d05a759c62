// Makes the running spectra of several axes available in Python as fltea._native.Octaves
// (host/fltea/spectrum/octaves.py).
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cstring>
#include <mutex>
#include <tuple>
#include <vector>

#include "engine_binding.hpp"
#include "number_io.hpp"
#include "octave_peak.hpp"
#include "octaves.hpp"
#include "sensor.hpp"

namespace nb = nanobind;

namespace {

using Lane = fltea::Octaves<double>;
using Ladder = fltea::engine::OctaveLadder<fltea::RealSpectrum<double>>;

constexpr double kLeastMemory = 256, kMostMemory = 1e12;
constexpr double kMostSamples = 1e15;

template <typename T>
nb::bytes bytes_of(const T* values, size_t n) {
    return nb::bytes(values, n * sizeof(T));
}

class Octaves : public fltea::SumsPart {
  public:
    Octaves(size_t lanes, double memory) : memory_(memory) {
        if (lanes == 0) throw nb::value_error("there must be at least one lane");
        if (!(memory == 0 || (memory >= kLeastMemory && memory <= kMostMemory))) {
            throw nb::value_error("the memory must be 0 (nothing is forgotten) or 256 samples to 10^12");
        }
        lanes_.assign(lanes, Lane(memory));
    }

    Octaves(const Octaves& other) : memory_(other.memory_), lanes_(other.copy()) {}

    void add(Rows y) {
        const size_t rows = y.shape(0), lanes = lanes_.size();
        if (y.shape(1) != lanes) throw nb::value_error("y must have shape (rows, lanes)");
        check_numbers("y", y.data(), rows, lanes, nullptr, fltea::kLargestSample);
        const LockGivenAway given(rows);
        const std::lock_guard<std::mutex> alone(mutex_);
        for (size_t i = 0; i < lanes; ++i) lanes_[i].add(y.data() + i, rows, lanes);
    }

    void add_at_rest(Rows y, Flags moving, double longest) {
        const size_t rows = y.shape(0), lanes = lanes_.size();
        if (y.shape(1) != lanes || moving.shape(0) != rows || moving.shape(1) != lanes)
            throw nb::value_error("y and moving must have shape (rows, lanes)");
        check_numbers("y", y.data(), rows, lanes, nullptr, fltea::kLargestSample);
        if (!(longest >= 0 && longest <= kMostSamples))
            throw nb::value_error("longest must be 0 to 10^15 samples");
        const LockGivenAway given(rows);
        add(y.data(), moving.data(), rows, static_cast<uint64_t>(longest));
    }

    void add(const double* y, const uint8_t* moving, size_t rows, uint64_t longest) override {
        const size_t lanes = lanes_.size();
        const std::lock_guard<std::mutex> alone(mutex_);
        for (size_t i = 0; i < lanes; ++i) lanes_[i].add(y + i, moving + i, rows, lanes, longest);
    }

    void skip(double count) {
        if (!(count >= 0 && count <= kMostSamples))
            throw nb::value_error("the number of lost samples must be 0 to 10^15");
        skip_rows(static_cast<uint64_t>(count));
    }

    void skip_rows(uint64_t count) override {
        const std::lock_guard<std::mutex> alone(mutex_);
        for (Lane& lane : lanes_) lane.skip(count);
    }

    void merge(const Octaves& other) {
        if (other.lanes_.size() != lanes_.size() || other.memory_ != memory_) {
            throw nb::value_error("the other spectrum has another number of lanes or another memory");
        }
        const Octaves* const self = this;
        const std::vector<Lane> theirs = self == &other ? lanes_ : other.copy();
        nb::gil_scoped_release release;
        const std::lock_guard<std::mutex> alone(mutex_);
        for (size_t i = 0; i < lanes_.size(); ++i) lanes_[i].merge(theirs[i]);
    }

    // Returns the counts of an axis's samples, which are the fields of GateCounts and then those of
    // MotionCounts, in order. Also returns whether all samples so far were equal.
    std::tuple<std::vector<uint64_t>, bool> counts(size_t lane) const {
        const std::lock_guard<std::mutex> alone(mutex_);
        const fltea::engine::GateCounts& c = at(lane).counts();
        const fltea::MotionCounts& motion = at(lane).motion();
        return {{c.taken, c.used, c.bridged, c.lost, c.gaps, c.knocks, c.knocked, c.steps, c.changes,
                 c.limited, motion.moved, motion.motions},
                at(lane).constant()};
    }

    uint64_t noticed() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        uint64_t found = 0;
        for (const Lane& lane : lanes_) found += lane.counts().steps + lane.counts().changes;
        return found;
    }

    // Returns three things. First, a list with an entry for each level that has Welch sums (sums of the power
    // spectra of blocks): the sums of |FFT|^2, the number of blocks, and the effective number of blocks.
    // Second, the samples (float32) of the level with the next lower sampling rate, which keeps them as they
    // are. Third, the number of these samples in each stretch (int32).
    nb::tuple spectrum(size_t lane) const {
        const Lane finished = finished_lane(lane);
        const Ladder& ladder = finished.ladder();
        nb::list levels;
        for (int l = 0; l < ladder.depth(); ++l) {
            double power[Ladder::kTopLines], blocks, effective;
            ladder.sums(l, finished.now(), power, &blocks, &effective);
            levels.append(
                nb::make_tuple(bytes_of(power, static_cast<size_t>(Ladder::lines(l))), blocks, effective));
        }
        std::vector<int32_t> lengths;
        for (int i = 0; i < ladder.whole().stretches(); ++i)
            lengths.push_back(ladder.whole().stretch(i).length);
        return nb::make_tuple(levels,
                              bytes_of(ladder.whole().values(), static_cast<size_t>(ladder.whole().size())),
                              bytes_of(lengths.data(), lengths.size()));
    }

    // Returns the number of the next sample, and six columns for each level. Four columns describe the
    // level's time cells: first sample number, count, mean and sum of squared deviations of each cell. Two
    // columns describe the level's time scales: for each scale, the number of pairs of neighbouring groups
    // whose means were compared, and the wavelet variance (time_scales.hpp).
    nb::tuple cells(size_t lane) const {
        Lane finished = finished_lane(lane);
        finished.deepen();
        const Ladder& ladder = finished.ladder();
        nb::list levels;
        for (int l = 0; l < ladder.depth(); ++l) {
            levels.append(l == 0 ? cells_of(ladder.top_cells()) : cells_of(ladder.cells(l)));
        }
        return nb::make_tuple(finished.now(), levels);
    }

    // Returns four things: the averaging factors; the Allan variance at each factor; the number of terms that
    // were averaged for each of these variances; and the number of recent samples that all this describes.
    std::tuple<std::vector<double>, std::vector<double>, std::vector<double>, double> allan(
        size_t lane) const {
        const Lane finished = finished_lane(lane);
        std::vector<double> factors, avar, terms;
        for (const fltea::allan::Point& one : finished.allan().points()) {
            factors.push_back(one.factor);
            avar.push_back(one.avar);
            terms.push_back(one.terms);
        }
        return {factors, avar, terms, finished.allan().span()};
    }

    nb::bytes save() const {
        std::vector<double> numbers;
        fltea::NumberSaver saver(numbers);
        for (Lane& lane : copy()) lane.visit(saver);
        return bytes_of(numbers.data(), numbers.size());
    }

    void load(nb::bytes bytes) {
        std::vector<double> numbers(bytes.size() / sizeof(double));
        if (!numbers.empty()) std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(double));
        std::vector<Lane> lanes(lanes_.size(), Lane(memory_));
        fltea::NumberLoader loader(numbers.data(), numbers.data() + numbers.size());
        for (Lane& lane : lanes) lane.visit(loader);
        if (!loader.sound() || !loader.at_end() || bytes.size() % sizeof(double) != 0) {
            throw nb::value_error("the saved spectrum cannot be read");
        }
        const std::lock_guard<std::mutex> alone(mutex_);
        lanes_ = lanes;
    }

  private:
    template <typename Cells>
    static nb::tuple cells_of(const Cells& cells) {
        std::vector<double> numbers, scales;
        for (int i = 0; i < cells.size(); ++i) {
            for (const double one :
                 {static_cast<double>(cells[i].first), static_cast<double>(cells[i].count),
                  static_cast<double>(cells[i].mean), static_cast<double>(cells[i].squares)}) {
                numbers.push_back(one);
            }
        }
        for (int s = 0; s < cells.scales().size(); ++s) {
            scales.push_back(cells.scales().pairs(s));
            scales.push_back(cells.scales().variance(s));
        }
        return nb::make_tuple(bytes_of(numbers.data(), numbers.size()),
                              bytes_of(scales.data(), scales.size()));
    }

    const Lane& at(size_t lane) const {
        if (lane >= lanes_.size()) throw nb::index_error("no such lane");
        return lanes_[lane];
    }
    Lane finished_lane(size_t lane) const {
        const std::lock_guard<std::mutex> alone(mutex_);
        return at(lane).finished();
    }
    std::vector<Lane> copy() const {
        const std::lock_guard<std::mutex> alone(mutex_);
        return lanes_;
    }

    double memory_;
    std::vector<Lane> lanes_;
    mutable std::mutex mutex_;
};

using Column = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Returns the indexes of the lines at which the most significant peak begins and ends, and the noise level
// around it, or None if there is no peak.
nb::object strongest_octave_peak(Column power, Column weight, double false_alarm) {
    if (power.shape(0) != weight.shape(0)) throw nb::value_error("each line has a power and a weight");
    if (!(false_alarm > 0 && false_alarm < 1)) throw nb::value_error("a probability is between 0 and 1");
    const auto found =
        fltea::peak::Search(power.data(), weight.data(), power.shape(0)).strongest(false_alarm);
    if (!found.any) return nb::none();
    return nb::make_tuple(found.start, found.stop, found.level);
}

std::vector<double> half_band_gains(Column angles) {
    std::vector<double> gains(angles.shape(0));
    std::transform(angles.data(), angles.data() + gains.size(), gains.begin(), fltea::half_band_gain);
    return gains;
}

}  // namespace

void bind_octaves(nb::module_& m) {
    m.attr("OCTAVES_LANE_BYTES") = sizeof(Lane);
    m.attr("OCTAVES_LEVELS") = static_cast<int>(Ladder::kLevels);
    m.attr("OCTAVES_WHOLE") = static_cast<int>(Ladder::Whole::kCapacity);
    m.attr("OCTAVES_BLOCK") = static_cast<int>(Ladder::Top::kBlock);
    m.attr("OCTAVES_LOWEST") = static_cast<int>(Ladder::Top::kLowest);
    m.attr("OCTAVES_LINES") =
        nb::make_tuple(static_cast<int>(Ladder::kTopLines), static_cast<int>(Ladder::kLines));
    m.def("strongest_octave_peak", &strongest_octave_peak, nb::arg("power"), nb::arg("weight"),
          nb::arg("false_alarm"));
    m.def("half_band_gains", &half_band_gains, nb::arg("angles"));
    nb::class_<Octaves, fltea::SumsPart>(m, "Octaves")
        .def(nb::init<size_t, double>(), nb::arg("lanes"), nb::arg("memory"))
        .def("add", nb::overload_cast<Rows>(&Octaves::add), nb::arg("y"))
        .def("add_at_rest", &Octaves::add_at_rest, nb::arg("y"), nb::arg("moving"), nb::arg("longest"))
        .def("skip", &Octaves::skip, nb::arg("count"))
        .def("merge", &Octaves::merge, nb::arg("other"))
        .def("counts", &Octaves::counts, nb::arg("lane"))
        .def("noticed", &Octaves::noticed)
        .def("spectrum", &Octaves::spectrum, nb::arg("lane"))
        .def("cells", &Octaves::cells, nb::arg("lane"))
        .def("allan", &Octaves::allan, nb::arg("lane"))
        .def("copy", [](const Octaves& self) { return Octaves(self); })
        .def("save", &Octaves::save)
        .def("load", &Octaves::load, nb::arg("bytes"));
}
