// Prints the samples of a device's runs as JSON lines; a run is a series of samples that Device processed
// together. The columns of a run are numbered as in host/fltea/sinks/json_lines.py.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

#include "device.hpp"
#include "line_printer.hpp"

namespace fltea {

class RunPrinter {
  public:
    // `every`: only samples whose number is a multiple of this are printed. `weight`: number of records in
    // the printed text of a sample. `shape`: the columns that a run must have in order to be printed (a
    // RunShape without the sensors that have no samples). Throws std::invalid_argument for impossible
    // arguments.
    RunPrinter(std::shared_ptr<const LinePrinter> lines, std::int64_t every, std::size_t weight,
               RunShape shape)
        : lines_(std::move(lines)), every_(every), weight_(weight), shape_(std::move(shape)) {
        if (every < 1) throw std::invalid_argument("every must be 1 or more");
        if (shape_.size() < kOfSensors || (shape_.size() - kOfSensors) % kOfSensor != 0)
            throw std::invalid_argument(
                "shape must have the numbers of the samples' columns and of each sensor's columns");
        is_corrected_ = lines_->uses(kCorrected);
        const std::vector<std::size_t> widths = widths_of(shape_);
        for (const LinePrinter::Hole& hole : lines_->holes()) {
            if (hole.column >= widths.size() || hole.place >= widths[hole.column])
                throw std::invalid_argument("a line prints a column that is not given");
        }
    }

    // Whether the newest run has the columns that this printer prints, so that its rows will be printed.
    bool prints(const Device& device) const {
        return missed_ == 0 && shape_of(device, Absent::kLeftOut) == shape_;
    }

    // Prints rows of the newest run. The rows may have other columns than `shape` says. In this case, nothing
    // is printed any more until clear() is called: these and all later rows are only counted.
    void append(const Device& device, std::size_t begin, std::size_t end) {
        if (begin >= end) return;
        if (missed_ > 0 || shape_of(device, Absent::kLeftOut) != shape_) {
            missed_ += end - begin;
            return;
        }
        const auto every = static_cast<std::size_t>(every_);
        const std::int64_t over = device.run().seq[begin] % every_;
        const std::size_t first = begin + (over == 0 ? 0 : static_cast<std::size_t>(every_ - over));
        if (first >= end) return;
        const std::size_t rows = (end - first - 1) / every + 1, room = lines_->room(rows);
        if (data_.size() - used_ < room) data_.resize(std::max(used_ + room, 2 * data_.size()));
        lay_out(device, first, end, every);
        char* const out = data_.data() + used_;
        used_ += static_cast<std::size_t>(lines_->print(columns_.data(), first, end, every, out) - out);
        records_ += rows * weight_;
    }

    const char* data() const { return data_.data(); }
    std::size_t size() const { return used_; }
    std::size_t records() const { return records_; }
    // Number of rows that could not be printed since the last call of clear().
    std::size_t missed() const { return missed_; }

    // Removes the printed text. Call this after the text was fetched.
    void clear() {
        if (data_.size() > kKept && used_ < data_.size() / 8) std::vector<char>().swap(data_);
        used_ = records_ = missed_ = 0;
    }

  private:
    enum : std::size_t { kCorrected = 7, kOfSensors = 4, kOfSensor = 3 };
    // kNumbers: number of columns with numbers among the columns of the algorithm's estimates (AxisBank);
    // columns with flags follow them. kBias: index of the bias among a tracker's columns.
    enum : std::size_t { kNumbers = kLaneInnovationStd, kBias = 2 };
    // If the memory for text is larger than this and only a little of it is used, it is released. There may
    // be many devices, and after a wait much text of one device may come at once.
    static constexpr std::size_t kKept = 1 << 16;

    static bool has_samples(const SensorColumns& one) { return one.tracked != nullptr; }

    // Returns for each column how many values it has in a row. The number is 0 if the run does not have the
    // column.
    static std::vector<std::size_t> widths_of(const RunShape& shape) {
        std::vector<std::size_t> widths = {1, 1, 1, shape[0], shape[1], shape[2], shape[3], 0};
        for (std::size_t i = kOfSensors; i < shape.size(); i += kOfSensor) {
            if (!shape[i + 1] && widths[kCorrected] == 0) widths[kCorrected] = shape[i];
            if (shape[i + 2]) widths.insert(widths.end(), kNumbers + 2, shape[i]);
        }
        for (std::size_t i = kOfSensors; i < shape.size(); i += kOfSensor)
            widths.insert(widths.end(), kTrackedColumns + 1, shape[i]);
        return widths;
    }

    void lay_out(const Device& device, std::size_t first, std::size_t end, std::size_t every) {
        const RunColumns& run = device.run();
        columns_.clear();
        add(run.seq, 1);
        add(run.device_us, 1);
        add(run.host_ns, 1);
        add(run.gyro_dps, run.gyro_width);
        add(run.accel_ms2, run.accel_width);
        add(run.temperature_c, 1);
        add(run.flags, 1);
        columns_.push_back({});
        if (is_corrected_) correct(device, first, end, every);
        for (std::size_t k = 0; k < run.sensors.size(); ++k) {
            if (!has_samples(run.sensors[k]) || !run.sensors[k].has_estimates) continue;
            const BankBlock& bank = run.sensors[k].bank;
            const std::size_t axes = device.sensors[k].places.size();
            for (std::size_t c = 0; c < kNumbers; ++c) add(bank.columns[c], axes);
            add(bank.valid, axes);
            add(bank.white, axes);
        }
        for (std::size_t k = 0; k < run.sensors.size(); ++k) {
            if (!has_samples(run.sensors[k])) continue;
            const std::size_t axes = device.sensors[k].places.size();
            for (std::size_t c = 0; c < kTrackedColumns; ++c)
                add(run.sensors[k].tracked + c * run.n * axes, axes);
            add(run.sensors[k].moving, axes);
        }
    }

    // Computes the corrected rates of the gyroscope, which are the rates of its tracked axes minus the biases
    // of these axes.
    void correct(const Device& device, std::size_t first, std::size_t end, std::size_t every) {
        const RunColumns& run = device.run();
        std::size_t k = 0;
        while (device.sensors[k].is_accel || !has_samples(run.sensors[k])) ++k;
        const std::vector<std::size_t>& places = device.sensors[k].places;
        const std::size_t axes = places.size();
        const double* const bias = run.sensors[k].tracked + kBias * run.n * axes;
        corrected_dps_.resize(run.n * axes);
        for (std::size_t row = first; row < end; row += every) {
            for (std::size_t a = 0; a < axes; ++a)
                corrected_dps_[row * axes + a] =
                    run.gyro_dps[row * run.gyro_width + places[a]] - bias[row * axes + a];
        }
        columns_.pop_back();
        add(corrected_dps_.data(), axes);
    }

    static Cells::Kind kind_of(const double*) { return Cells::kReal; }
    static Cells::Kind kind_of(const std::int64_t*) { return Cells::kWhole; }
    static Cells::Kind kind_of(const std::uint8_t*) { return Cells::kFlag; }
    template <typename T>
    void add(const T* first, std::size_t width) {
        const auto row = static_cast<std::ptrdiff_t>(width * sizeof(T));
        columns_.push_back({first, row, static_cast<std::ptrdiff_t>(sizeof(T)), kind_of(first)});
    }

    std::shared_ptr<const LinePrinter> lines_;
    std::int64_t every_;
    std::size_t weight_;
    RunShape shape_;
    bool is_corrected_ = false;
    // the first `used_` bytes are printed text; what follows is left over from earlier texts
    std::vector<char> data_;
    std::size_t used_ = 0, records_ = 0, missed_ = 0;
    std::vector<Cells> columns_;
    std::vector<double> corrected_dps_;
};

}  // namespace fltea
