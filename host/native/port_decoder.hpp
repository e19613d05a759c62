// Decodes what came from one serial port into items, in the order of arrival. Items are samples, other
// frames, troubles of the port, and ticks, which come at regular times while the port is silent.
//
// The items and the counts depend only on the bytes and their arrival times, never on how many reads are
// passed at once. This class allocates memory only until its buffers have grown to the necessary size.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "decoder.hpp"
#include "port_item.hpp"
#include "port_read.hpp"
#include "port_watch.hpp"
#include "wire_samples.hpp"

namespace fltea {

// To use this decoder, call one of the functions that take input, and then next() until it returns an item
// kDone. Items that the caller has not fetched before the next input are dropped.
class PortDecoder {
  public:
    // If this program itself was stalled for longer than this, missing bytes do not prove that the port was
    // silent.
    static constexpr std::int64_t kStallNs = 2 * kSecondNs;
    // Largest number of ticks (items that say that no bytes have come) for one silence of the port. In a
    // recording, a silence may last for days.
    static constexpr std::int64_t kMostTicks = 120;

    explicit PortDecoder(const PortTimes& times) : times_(times), watch_(times) {}

    const PortCounts& counts() const { return counts_; }
    // Unix time minus host time at the newest input from which the caller has received an item.
    std::int64_t unix_offset_ns = 0;

    // Call this when the port was opened, for the first time or again.
    void opened(const Stamp& at) {
        drop();
        unix_offset_ns = at.unix_offset_ns;
        watch_.on_opened(at.host_ns);
        ++counts_.connections;
        decoder_.reset();
        set_last(at.host_ns);
    }

    // Call this when the port could not be opened or was lost. Returns whether this failure has to be
    // reported. There are no items for a failure.
    bool failed(const char* kind, const Stamp& at) {
        drop();
        unix_offset_ns = at.unix_offset_ns;
        watch_.on_failed();
        set_last(at.host_ns);
        return watch_.is_news(kind, at.host_ns);
    }

    // Input: the bytes of `n` consecutive reads, one after another; there are reads[n - 1].end bytes. If
    // nothing came for a while between two reads, next() also returns ticks for that time.
    void feed(const std::uint8_t* data, const PortRead* reads, std::size_t n, std::int64_t now_ns) {
        begin(data, reads, n, now_ns);
        tells_time_ = true;
    }

    // Input: the bytes of one read. This makes no ticks for the time before the read, because the caller has
    // already called silent() for it.
    void feed_one(const std::uint8_t* data, const PortRead& read, std::int64_t now_ns) {
        begin(data, &read, 1, now_ns);
        tells_time_ = false;
    }

    // Input: no bytes have come for a while, up to the time `now_ns`.
    void silent(std::int64_t now_ns) {
        drop();
        forgive_stall(now_ns);
        if (!has_last_ || time_between(last_ns_, now_ns) < times_.tick_ns) {
            next_tick_ns_ = now_ns;
            ticks_left_ = 1;
        } else {
            begin_ticks(now_ns);
        }
    }

    // Input: no bytes will come before the time `until_ns`. After this, next() returns the ticks up to that
    // time; a tick says that no bytes have come.
    void pass_time(std::int64_t until_ns) {
        drop();
        begin_ticks_before(until_ns);
    }

    // Begins again to measure the times after which a trouble is reported. Call this if the program could not
    // read the port until now.
    void forgive(std::int64_t now_ns) {
        watch_.forgive(now_ns);
        has_last_ = false;
    }

    // Notes when this program continued, so that a stall of the program is not taken for a silence of the
    // port.
    void resume(std::int64_t now_ns) {
        has_before_ = true;
        before_ns_ = now_ns;
    }

    // Accepts the HELLO that next() returned last. Call this or refuse_hello() before the next call of
    // next(), because the decision determines how the following bytes are interpreted.
    void accept_hello() {
        accepted_.assign(hello_, hello_ + hello_size_);
        watch_.on_hello(true);
    }
    // Refuses the HELLO that next() returned last. Returns whether this refusal has to be reported.
    bool refuse_hello() {
        watch_.on_hello(false);
        return watch_.is_news("bad_hello", hello_ns_);
    }

    PortItem next() {
        count_handed();
        PortItem item;
        for (;;) {
            if (check_is_due_ && check(item)) return item;
            if (ticks_left_ > 0) return tick();
            if (in_part_) {
                if (next_of_part(item)) return item;
                end_part();
            } else if (at_ < reads_.size()) {
                next_part();
            } else {
                return item;
            }
        }
    }

  private:
    // What the caller received with the last item: the offset at which that item ended, and its number of
    // frames. The next call of next() adds these to the counts.
    struct Handed {
        bool is_any = false;
        std::int64_t end = 0, frames = 0;
        Reason reason = Reason::none;
    };

    void set_last(std::int64_t host_ns) {
        has_last_ = true;
        last_ns_ = host_ns;
    }

    void forgive_stall(std::int64_t now_ns) {
        if (has_before_ && time_between(before_ns_, now_ns) > kStallNs) forgive(now_ns);
    }

    void drop() {
        count_handed();
        reads_.clear();
        at_ = group_end_ = 0;
        ticks_left_ = 0;
        in_part_ = check_is_due_ = false;
    }

    void begin(const std::uint8_t* data, const PortRead* reads, std::size_t n, std::int64_t now_ns) {
        drop();
        forgive_stall(now_ns);
        bytes_.assign(data, data + reads[n - 1].end);
        reads_.assign(reads, reads + n);
    }

    // Begins to return ticks for the time from the last event until `now_ns`.
    void begin_ticks(std::int64_t now_ns) {
        if (!has_last_ || time_between(last_ns_, now_ns) < times_.tick_ns) return;
        ticks_left_ = std::min(kMostTicks, time_between(last_ns_, now_ns) / times_.tick_ns);
        next_tick_ns_ = last_ns_ + times_.tick_ns;
    }
    void begin_ticks_before(std::int64_t until_ns) {
        if (until_ns > std::numeric_limits<std::int64_t>::min()) begin_ticks(until_ns - 1);
    }

    PortItem tick() {
        PortItem item;
        item.kind = PortItem::kTick;
        item.host_ns = next_tick_ns_;
        set_last(next_tick_ns_);
        check_is_due_ = true;
        if (--ticks_left_ > 0) next_tick_ns_ += times_.tick_ns;
        return item;
    }

    bool check(PortItem& item) {
        check_is_due_ = false;
        item.trouble = watch_.check(last_ns_);
        if (item.trouble == PortTrouble::none) return false;
        item.kind = PortItem::kTrouble;
        item.host_ns = last_ns_;
        item.unread_bytes = watch_.unread_bytes();
        return true;
    }

    std::int64_t end_before(std::size_t read) const { return read == 0 ? 0 : reads_[read - 1].end; }

    // Continues with the next part of the input. A part consists of the reads that are decoded together.
    // These are all reads within one second that came close to each other. But if a trouble of the port may
    // have to be reported between two of them, a part is a single read. Ticks for the silence before the part
    // come first.
    void next_part() {
        if (at_ == group_end_) {
            group_end_ = end_of_group();
            is_judged_ = false;
            if (tells_time_) begin_ticks_before(reads_[at_].stamp.host_ns);
            if (ticks_left_ > 0) return;
        }
        if (!is_judged_) {
            is_settled_ = watch_.is_settled(reads_[group_end_ - 1].stamp.host_ns);
            is_judged_ = true;
        }
        begin_part(is_settled_ ? group_end_ : at_ + 1);
    }

    std::size_t end_of_group() const {
        const auto second = [](std::int64_t ns) { return ns / kSecondNs - (ns % kSecondNs < 0); };
        std::size_t end = at_ + 1;
        for (; end < reads_.size(); ++end) {
            const std::int64_t before_ns = reads_[end - 1].stamp.host_ns, ns = reads_[end].stamp.host_ns;
            if (time_between(before_ns, ns) > times_.tick_ns || second(before_ns) != second(ns)) break;
        }
        return end;
    }

    void begin_part(std::size_t end) {
        part_begin_ = at_;
        at_ = end;
        base_ = end_before(part_begin_);
        const std::int64_t size = end_before(end) - base_, last_ns = reads_[end - 1].stamp.host_ns;
        watch_.on_bytes(reads_[part_begin_].stamp.host_ns, last_ns, size);
        set_last(last_ns);
        bytes_before_ = bytes_in_;
        bytes_in_ += size;
        found_.samples.clear();
        found_.others.clear();
        found_.bytes.clear();
        decoder_.feed(bytes_.data() + base_, static_cast<std::size_t>(size), found_);
        samples_.lay_out(found_.samples, reads_.data() + part_begin_, base_);
        row_ = other_ = 0;
        in_part_ = true;
    }

    void end_part() {
        in_part_ = false;
        unix_offset_ns = reads_[at_ - 1].stamp.unix_offset_ns;
        check_is_due_ = true;
    }

    // Returns the read (one call of the system's read()) that brought the last byte of a frame. `end`: number
    // of bytes from the beginning of the present part (next_part()) to the end of the frame.
    const PortRead* read_of(std::int64_t end) const {
        return std::lower_bound(reads_.data() + part_begin_, reads_.data() + at_, base_ + end,
                                [](const PortRead& read, std::int64_t at) { return read.end < at; });
    }

    // Writes the next item to `item`. Returns false at the end of the part of the input that is being decoded
    // (next_part()).
    bool next_of_part(PortItem& item) {
        for (;;) {
            const bool is_last = other_ == found_.others.size();
            const std::size_t stop = is_last ? found_.samples.size() : found_.others[other_].row;
            if (row_ < stop && !watch_.is_refused()) {
                give_samples(stop, item);
                return true;
            }
            if (row_ < stop) {
                counts_.refused += static_cast<std::int64_t>(stop - row_);
                hand_run(stop);
                row_ = stop;
                count_handed();
            }
            if (is_last) return false;
            if (give_other(found_.others[other_++], item)) return true;
        }
    }

    // Makes an item of the next samples. The item ends before the first sample whose sequence number does not
    // follow the previous one, because an epoch may begin with that sample.
    void give_samples(std::size_t stop, PortItem& item) {
        const std::size_t from = row_;
        row_ = samples_.end_of_sequence(from, stop);
        item.kind = PortItem::kSamples;
        item.samples = samples_.rows(from, row_);
        item.host_ns = item.samples.host_ns[0];
        unix_offset_ns = read_of(found_.samples[from].end)->stamp.unix_offset_ns;
        if (row_ == stop) hand_run(stop);
    }

    // Notes that the caller has received the samples between the last frame of another type and the sample
    // with the index `stop` in found_.samples, which is not included.
    void hand_run(std::size_t stop) {
        const std::size_t begin = other_ == 0 ? 0 : found_.others[other_ - 1].row;
        handed_ = {true, found_.samples[stop - 1].end, static_cast<std::int64_t>(stop - begin), Reason::none};
    }

    // Makes an item of a frame that is no sample, or of a bad block. If the frame comes from a device that
    // was refused, there is no item, and the function returns false.
    bool give_other(const OtherRow& other, PortItem& item) {
        const PortRead& read = *read_of(other.end);
        unix_offset_ns = read.stamp.unix_offset_ns;
        handed_ = {true, other.end, 1, other.reason};
        item.host_ns = read.stamp.host_ns;
        item.type = other.type;
        item.sequence = other.sequence;
        item.device_us = other.device_us;
        item.bytes = found_.bytes.data() + other.offset;
        item.size = other.size;
        item.reason = other.reason;
        if (other.reason != Reason::none) {
            item.kind = PortItem::kBad;
        } else if (other.type == Hello::type()) {
            give_hello(item);
        } else if (watch_.is_refused()) {
            ++counts_.refused;
            count_handed();
            return false;
        } else {
            item.kind = PortItem::kFrame;
        }
        return true;
    }

    void give_hello(PortItem& item) {
        hello_ = item.bytes;
        hello_size_ = item.size;
        hello_ns_ = item.host_ns;
        if (is_other_version(item.bytes, item.size)) {
            item.kind = PortItem::kRefusedVersion;
            handed_.frames = 0;
            ++counts_.refused;
            watch_.on_hello(false);
            item.is_news = watch_.is_news("version", item.host_ns);
        } else if (std::equal(accepted_.begin(), accepted_.end(), hello_, hello_ + hello_size_)) {
            item.kind = PortItem::kSameHello;
            watch_.on_hello(true);
        } else {
            item.kind = PortItem::kFrame;
        }
    }

    // Counts what the caller received with the last item. Later bytes are not counted yet, even if they are
    // decoded already, so that the counts do not depend on how the bytes were read.
    void count_handed() {
        hello_size_ = 0;
        if (!handed_.is_any) return;
        handed_.is_any = false;
        counts_.bytes = bytes_before_ + handed_.end;
        if (handed_.reason != Reason::none) {
            counts_.add_bad(handed_.reason);
            return;
        }
        counts_.frames += handed_.frames;
        const PortRead* const read = read_of(handed_.end);
        if (read + 1 >= reads_.data() + at_) {
            watch_.on_all_read();
        } else {
            watch_.on_read_but(end_before(at_) - read->end, read[1].stamp.host_ns);
        }
    }

    PortTimes times_;
    PortWatch watch_;
    Decoder decoder_;
    PortCounts counts_;
    Handed handed_;
    bool has_before_ = false, has_last_ = false;
    std::int64_t before_ns_ = 0;  // time at which this program had last processed all input
    std::int64_t last_ns_ = 0;    // time of the last event or tick
    std::int64_t ticks_left_ = 0, next_tick_ns_ = 0;
    bool check_is_due_ = false;  // whether troubles have to be looked for, up to last_ns_

    // The input. Reads before the index `at_` are being decoded or are decoded already. Reads that came close
    // to each other are a group; the present group ends before the index `group_end_`.
    std::vector<std::uint8_t> bytes_;
    std::vector<PortRead> reads_;
    std::size_t at_ = 0, group_end_ = 0;
    bool tells_time_ = false, is_judged_ = false, is_settled_ = false;

    // The part of the input that is being decoded (next_part()): the reads from index `part_begin_` to before
    // `at_`. Their bytes begin at the offset `base_`.
    bool in_part_ = false;
    std::size_t part_begin_ = 0, row_ = 0, other_ = 0;
    std::int64_t base_ = 0, bytes_in_ = 0, bytes_before_ = 0;
    Decoded found_;
    WireSamples samples_;

    std::vector<std::uint8_t> accepted_;  // payload of the last accepted HELLO
    const std::uint8_t* hello_ = nullptr;
    std::size_t hello_size_ = 0;
    std::int64_t hello_ns_ = 0;
};

}  // namespace fltea
