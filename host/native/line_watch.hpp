// Whether a line is silent, unreadable or without a HELLO, and which trouble is news.
#pragma once

#include <cstdint>
#include <limits>
#include <string>

namespace fltea {

constexpr std::int64_t kSecondNs = 1'000'000'000;

// Times after which something is told [ns].
struct LineTimes {
    std::int64_t silence_ns;  // a device that says nothing, or nothing that can be read
    std::int64_t tick_ns;     // a line of which nothing comes
    std::int64_t repeat_ns;   // a trouble that was told already
};

// Of a line that is open; names: trouble_name().
enum class LineTrouble : std::uint8_t { none, silent, no_valid_frame, no_hello };

// As in host/docs/reference/errors.md; nullptr for none.
inline const char* trouble_name(LineTrouble trouble) {
    switch (trouble) {
        case LineTrouble::none:
            return nullptr;
        case LineTrouble::silent:
            return "silent";
        case LineTrouble::no_valid_frame:
            return "no_valid_frame";
        case LineTrouble::no_hello:
            return "no_hello";
    }
    return nullptr;
}

// From one moment to another; a recording can hold any, so what does not fit is as long as can be.
inline std::int64_t time_between(std::int64_t from_ns, std::int64_t to_ns) {
    std::int64_t found = 0;
    if (!__builtin_sub_overflow(to_ns, from_ns, &found)) return found;
    return to_ns < from_ns ? std::numeric_limits<std::int64_t>::min()
                           : std::numeric_limits<std::int64_t>::max();
}

class LineWatch {
  public:
    explicit LineWatch(const LineTimes& times) : times_(times) {}

    bool is_refused() const { return is_refused_; }
    // Bytes since a frame could be read last, or since a silence.
    std::int64_t unread_bytes() const { return unread_bytes_; }

    void on_opened(std::int64_t host_ns) {
        is_connected_ = true;
        is_refused_ = heard_hello_ = false;
        forgive(host_ns);
    }
    void on_failed() { is_connected_ = false; }

    // Begins all waiting again.
    void forgive(std::int64_t now_ns) {
        opened_ns_ = byte_ns_ = now_ns;
        has_unread_ = false;
    }

    void on_hello(bool is_accepted) {
        is_refused_ = !is_accepted;
        if (!is_accepted) return;
        heard_hello_ = true;
        reported_.clear();
    }

    void on_bytes(std::int64_t first_ns, std::int64_t last_ns, std::int64_t size) {
        if (!has_unread_ || time_between(byte_ns_, first_ns) >= times_.silence_ns) {
            has_unread_ = true;
            unread_since_ns_ = first_ns;
            unread_bytes_ = 0;
        }
        unread_bytes_ += size;
        byte_ns_ = last_ns;
    }
    // All that came could be read.
    void on_all_read() { has_unread_ = false; }
    // All but some bytes, the first of which came at this moment.
    void on_read_but(std::int64_t bytes, std::int64_t since_ns) {
        has_unread_ = true;
        unread_since_ns_ = since_ns;
        unread_bytes_ = bytes;
    }

    // Whether the line is open and a device known: then no trouble is due within a second.
    bool is_settled(std::int64_t until_ns) const {
        const std::int64_t unread_ns = has_unread_ ? time_between(unread_since_ns_, until_ns) : 0;
        return is_connected_ && heard_hello_ && !is_refused_ && unread_ns < times_.silence_ns - kSecondNs;
    }

    // The trouble of this moment, if it is news.
    LineTrouble look(std::int64_t now_ns) {
        const LineTrouble found = trouble_of(now_ns);
        const bool is_due = found != LineTrouble::none && is_news(trouble_name(found), now_ns);
        return is_due ? found : LineTrouble::none;
    }

    // Whether a trouble is not the one that was told last, or that was long ago; then it counts as told.
    bool is_news(const char* kind, std::int64_t now_ns) {
        if (reported_ == kind && time_between(reported_ns_, now_ns) <= times_.repeat_ns) return false;
        reported_ = kind;
        reported_ns_ = now_ns;
        return true;
    }

  private:
    LineTrouble trouble_of(std::int64_t now_ns) const {
        const auto is_long = [&](std::int64_t since_ns) {
            return time_between(since_ns, now_ns) >= times_.silence_ns;
        };
        if (!is_connected_) return LineTrouble::none;
        if (is_long(byte_ns_)) return LineTrouble::silent;
        if (has_unread_) return is_long(unread_since_ns_) ? LineTrouble::no_valid_frame : LineTrouble::none;
        const bool waits = !heard_hello_ && !is_refused_;
        return waits && is_long(opened_ns_) ? LineTrouble::no_hello : LineTrouble::none;
    }

    LineTimes times_;
    bool is_connected_ = false, is_refused_ = false, heard_hello_ = false;
    bool has_unread_ = false;  // bytes behind the last frame that could be read
    std::int64_t opened_ns_ = 0, byte_ns_ = 0, unread_since_ns_ = 0, unread_bytes_ = 0;
    std::string reported_;  // kind of the trouble that was told last; empty: all are news
    std::int64_t reported_ns_ = 0;
};

}  // namespace fltea
