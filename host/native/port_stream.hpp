// One device on a port: its bytes through the wire's line and the device, to printed lines and to rows for
// who takes them. It goes on by itself until something happens that is the caller's (LineStop).
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "device.hpp"
#include "line_item.hpp"
#include "port_reader.hpp"
#include "run_printer.hpp"
#include "run_rows.hpp"
#include "wire_line.hpp"

namespace fltea {

// What is the caller's; then `walk` is called again.
enum class PortStop : int {
    kNothing,  // all that came is taken
    kItem,     // an item of the line (item())
    kStop,     // a stop of the device (advanced(), samples())
    kRows,     // rows wait (rows()), which he clears
    kReads,    // bytes wait as they came (reads()), which he clears
    kLost,     // the port was lost behind all that came (news().error, news().lost)
    kFault,    // what came cannot be taken (Round::fault), and nothing more is
};

class PortStream {
  public:
    PortStream(WireLine& wire, Device& device, std::vector<RunPrinter*>& printers)
        : wire_(wire), device_(device), printers_(printers) {}

    // Somebody takes rows, prints lines, takes bytes as they came.
    bool wants_rows = false, wants_text = false, wants_reads = false;
    // How long rows and bytes may wait for more.
    std::int64_t patience_ns = 0;
    std::int64_t overflow_bytes = 0;

    // Rows or bytes wait for more, or the caller has not been told of all.
    bool is_waiting() const { return is_busy_ || is_lost_ || rows_.rows() > 0 || !reads_.reads.empty(); }
    // Bytes came since the port was lost last.
    bool has_worked() const { return has_worked_; }
    const LineItem& item() const { return item_; }
    const Advanced& advanced() const { return advanced_; }
    const SampleColumns& samples() const { return samples_; }
    const Device& device() const { return device_; }
    // When the sample arrived before which, or behind which, the device stopped.
    std::int64_t stopped_ns() const {
        return stands_before_sample(advanced_.stop) ? samples_.host_ns[advanced_.next] : now_ns_;
    }
    RunRows& rows() { return rows_; }
    PortNews& reads() { return reads_; }
    const PortNews& news() const { return news_; }
    // Rows that wait have not been printed: there is no text for them yet.
    bool is_unprinted() const { return is_unprinted_; }
    // When the newest of what was taken arrived or happened.
    std::int64_t now_ns() const { return now_ns_; }

    // When rows or bytes that wait are due.
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

    // Nothing came for a while.
    void tick(std::int64_t now_ns) {
        is_busy_ = true;
        taken_ns_ = now_ns;
        wire_.silent(now_ns);
    }

    PortStop walk(std::int64_t now_ns) {
        while (is_busy_) {
            if (held_ != PortStop::kNothing && !has_new_rows_) {
                if (rows_.rows() > 0) return PortStop::kRows;  // nothing overtakes samples
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

    // Whoever keeps the bytes has those of a HELLO before he learns what it says.
    bool says_hello() const { return item_.kind == LineItem::kFrame && item_.type == Hello::type(); }

    PortStop next() {
        item_ = wire_.next();
        if (item_.kind != LineItem::kDone) now_ns_ = item_.host_ns;
        switch (item_.kind) {
            case LineItem::kDone:
                wire_.resume(taken_ns_);
                is_busy_ = false;
                return PortStop::kNothing;
            case LineItem::kSamples:
                samples_ = item_.samples;
                has_samples_ = true;
                at_ = 0;
                return PortStop::kNothing;
            case LineItem::kBad:
                return PortStop::kNothing;
            case LineItem::kSameHello:  // as a device says once a second
                if (device_.place.knows_hello() && item_.host_ns < device_.stats_due_ns)
                    return PortStop::kNothing;
                return PortStop::kItem;
            case LineItem::kTick:
                return item_.host_ns < device_.stats_due_ns ? PortStop::kNothing : PortStop::kItem;
            case LineItem::kFrame:
            case LineItem::kRefusedVersion:
            case LineItem::kTrouble:
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

    WireLine& wire_;
    Device& device_;
    std::vector<RunPrinter*>& printers_;
    PortNews news_, reads_;
    LineItem item_;
    SampleColumns samples_ = {};
    Advanced advanced_ = {};
    std::size_t at_ = 0;
    std::vector<char> room_;  // of the columns of a run
    RunRows rows_;
    std::int64_t now_ns_ = 0, taken_ns_ = 0;
    bool worked_ = false, has_worked_ = false;
    bool is_busy_ = false, has_samples_ = false, is_lost_ = false;
    PortStop held_ = PortStop::kNothing;                   // the caller's, once he has all samples before it
    bool has_new_rows_ = false, is_text_missing_ = false;  // of the newest run
    bool is_unprinted_ = false;                            // rows that wait
};

}  // namespace fltea
