// Processes what comes from one device on a serial port: passes its bytes through the wire decoder and the
// device, and collects printed lines of text and rows of samples. It continues on its own until the caller
// has to do something (PortStop).
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "device.hpp"
#include "port_decoder.hpp"
#include "port_item.hpp"
#include "port_reader.hpp"
#include "run_printer.hpp"
#include "run_rows.hpp"

namespace fltea {

// Why run() returned. The caller does what is necessary, then calls run() again.
enum class PortStop : int {
    kNothing,  // all received bytes are processed
    kItem,     // a decoded item came that the caller has to handle (item())
    kStop,     // the device has stopped at a sample (advanced(), samples())
    kRows,     // rows of samples wait (rows()); the caller has to fetch and clear them
    kReads,    // raw bytes wait (reads()); the caller has to fetch and clear them
    // all received bytes are processed, and after them the port was lost (news().error, news().lost)
    kLost,
    kFault,  // the bytes cannot be processed (Round::fault); the stream has ended
};

class PortStream {
  public:
    PortStream(PortDecoder& wire, Device& device, std::vector<RunPrinter*>& printers)
        : wire_(wire), device_(device), printers_(printers) {}

    // Whether the caller wants rows of samples, printed lines, or the raw bytes.
    bool wants_rows = false, wants_text = false, wants_reads = false;
    // How long rows of samples and raw bytes may wait in this object, so that the caller can fetch many
    // together.
    std::int64_t patience_ns = 0;
    std::int64_t overflow_bytes = 0;

    // Whether anything still waits: rows of samples or raw bytes for the caller, or received bytes or a loss
    // of the port that are not processed yet.
    bool is_waiting() const { return is_busy_ || is_lost_ || rows_.rows() > 0 || !reads_.reads.empty(); }
    // After a loss of the port: whether any bytes had come from the port since its previous loss.
    bool has_worked() const { return has_worked_; }
    const PortItem& item() const { return item_; }
    const Advanced& advanced() const { return advanced_; }
    const SampleColumns& samples() const { return samples_; }
    const Device& device() const { return device_; }
    // Arrival time of the sample at which the device stopped.
    std::int64_t stopped_ns() const {
        return stands_before_sample(advanced_.stop) ? samples_.host_ns[advanced_.next] : now_ns_;
    }
    RunRows& rows() { return rows_; }
    PortNews& reads() { return reads_; }
    const PortNews& news() const { return news_; }
    // Whether the waiting rows were not printed as text, so that the caller has to print them.
    bool is_unprinted() const { return is_unprinted_; }
    // Arrival time of the newest sample or other item that was processed.
    std::int64_t now_ns() const { return now_ns_; }

    // Latest time at which the caller has to fetch the waiting rows or bytes.
    std::int64_t due_ns() const {
        std::int64_t due = Device::kNever;
        if (rows_.rows() > 0) due = rows_.first_ns() + patience_ns;
        if (!reads_.reads.empty()) due = std::min(due, reads_.reads.front().stamp.host_ns + patience_ns);
        return due;
    }

    void give(PortNews news, std::int64_t now_ns) {
        news_ = std::move(news);
        overflow_bytes += news_.overflow_bytes;
        is_lost_ = news_.error != 0;
        is_busy_ = true;
        taken_ns_ = now_ns;
        if (news_.bytes.empty()) return;
        worked_ = true;
        wire_.feed(news_.bytes.data(), news_.reads.data(), news_.reads.size(), now_ns);
        if (!wants_reads) return;
        const auto before = static_cast<std::int64_t>(reads_.bytes.size());
        reads_.bytes.insert(reads_.bytes.end(), news_.bytes.begin(), news_.bytes.end());
        for (PortRead read : news_.reads) {
            read.end += before;
            reads_.reads.push_back(read);
        }
    }

    // Call this if no bytes have come from the port for a while.
    void tick(std::int64_t now_ns) {
        is_busy_ = true;
        taken_ns_ = now_ns;
        wire_.silent(now_ns);
    }

    PortStop run(std::int64_t now_ns) {
        while (is_busy_) {
            if (held_ != PortStop::kNothing && !has_new_rows_) {
                // `held_` is the next stop that the caller has to learn of; first, it fetches the rows of
                // earlier samples
                if (rows_.rows() > 0) return PortStop::kRows;
                if (held_ == PortStop::kItem && says_hello() && !reads_.reads.empty())
                    return PortStop::kReads;
                return std::exchange(held_, PortStop::kNothing);
            }
            if (has_new_rows_) {
                if (rows_.rows() > 0 && (is_unprinted_ != is_text_missing_ || !rows_.takes(device_)))
                    return PortStop::kRows;
                keep_rows();
            } else if (has_samples_) {
                advance();
            } else {
                held_ = next();
            }
            if (rows_.rows() > 0 && (is_unprinted_ || patience_ns == 0 || rows_.rows() >= kMostRows))
                return PortStop::kRows;
        }
        if (rows_.rows() > 0 && (is_lost_ || now_ns >= rows_.first_ns() + patience_ns))
            return PortStop::kRows;
        const bool has_reads = !reads_.reads.empty();
        if (has_reads && (is_lost_ || reads_.bytes.size() >= kMostBytes ||
                          now_ns >= reads_.reads.front().stamp.host_ns + patience_ns))
            return PortStop::kReads;
        if (is_lost_) {
            is_lost_ = false;
            has_worked_ = worked_;
            worked_ = false;
            return PortStop::kLost;
        }
        return PortStop::kNothing;
    }

  private:
    static constexpr std::size_t kMostRows = 512, kMostBytes = 1 << 16;

    // Whether the present item is a HELLO. A caller that wants the raw bytes receives the bytes of a HELLO
    // before the item.
    bool says_hello() const { return item_.kind == PortItem::kFrame && item_.type == Hello::type(); }

    PortStop next() {
        item_ = wire_.next();
        if (item_.kind != PortItem::kDone) now_ns_ = item_.host_ns;
        switch (item_.kind) {
            case PortItem::kDone:
                wire_.resume(taken_ns_);
                is_busy_ = false;
                return PortStop::kNothing;
            case PortItem::kSamples:
                samples_ = item_.samples;
                has_samples_ = true;
                at_ = 0;
                return PortStop::kNothing;
            case PortItem::kBad:
                return PortStop::kNothing;
            case PortItem::kSameHello:  // devices repeat their HELLO once a second
                if (device_.place.knows_hello() && item_.host_ns < device_.stats_due_ns)
                    return PortStop::kNothing;
                return PortStop::kItem;
            case PortItem::kTick:
                return item_.host_ns < device_.stats_due_ns ? PortStop::kNothing : PortStop::kItem;
            case PortItem::kFrame:
            case PortItem::kRefusedVersion:
            case PortItem::kTrouble:
                break;
        }
        return PortStop::kItem;
    }

    void advance() {
        advanced_ = device_.advance(samples_, at_, [this](std::size_t bytes) {
            if (room_.size() < bytes) room_.resize(bytes);
            return static_cast<void*>(room_.data());
        });
        at_ = advanced_.next;
        if (advanced_.begin < advanced_.end) take_rows();
        has_samples_ = advanced_.stop != Stop::kEnd;
        if (!has_samples_) now_ns_ = samples_.host_ns[samples_.n - 1];
        if (has_samples_ && advanced_.stop != Stop::kMore) held_ = PortStop::kStop;
    }

    void take_rows() {
        const std::size_t begin = advanced_.begin, end = advanced_.end;
        now_ns_ = samples_.host_ns[device_.run().first + end - 1];
        const bool has_text = !printers_.empty() && printers_.front()->prints(device_);
        if (has_text) {
            for (RunPrinter* printer : printers_) printer->append(device_, begin, end);
        }
        is_text_missing_ = wants_text && !has_text;
        has_new_rows_ = wants_rows || is_text_missing_;
    }

    void keep_rows() {
        const std::size_t begin = advanced_.begin, end = advanced_.end;
        rows_.append(device_, samples_.host_ns + device_.run().first + begin, begin, end);
        is_unprinted_ = is_text_missing_;
        has_new_rows_ = false;
    }

    PortDecoder& wire_;
    Device& device_;
    std::vector<RunPrinter*>& printers_;
    PortNews news_, reads_;
    PortItem item_;
    SampleColumns samples_ = {};
    Advanced advanced_ = {};
    std::size_t at_ = 0;
    std::vector<char> room_;  // memory for the columns of a run of samples
    RunRows rows_;
    std::int64_t now_ns_ = 0, taken_ns_ = 0;
    bool worked_ = false, has_worked_ = false;
    bool is_busy_ = false, has_samples_ = false, is_lost_ = false;
    // what run() will return as soon as the caller has all earlier samples
    PortStop held_ = PortStop::kNothing;
    // has_new_rows_: the newest rows that the device has returned are not in `rows_` yet
    // is_text_missing_: these rows could not be printed
    bool has_new_rows_ = false, is_text_missing_ = false;
    bool is_unprinted_ = false;  // whether the caller has to print the rows that wait
};

}  // namespace fltea
