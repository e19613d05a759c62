// Watches one serial port. Detects when no bytes, no readable frames or no HELLO come from the port, and
// decides when such a trouble has to be reported.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <string>

namespace fltea {

constexpr std::int64_t kSecondNs = 1'000'000'000;

// Times after which a trouble is reported [ns].
struct PortTimes {
    // there is a trouble if a device has sent nothing, or nothing readable, or no HELLO for this time
    std::int64_t silence_ns;
    std::int64_t tick_ns;    // a port without bytes for this time gives an item kTick
    std::int64_t repeat_ns;  // after this time, the same trouble is reported again
};

// Trouble of an open port. trouble_name() gives the names.
enum class PortTrouble : std::uint8_t { none, silent, no_valid_frame, no_hello };

// Returns the name of a trouble, as in host/docs/reference/errors.md, or nullptr for PortTrouble::none.
inline const char* trouble_name(PortTrouble trouble) {
    switch (trouble) {
        case PortTrouble::none:
            return nullptr;
        case PortTrouble::silent:
            return "silent";
        case PortTrouble::no_valid_frame:
            return "no_valid_frame";
        case PortTrouble::no_hello:
            return "no_hello";
    }
    return nullptr;
}

// Returns the time from one moment to another. A recording may contain any times, so a difference that would
// overflow is limited to the range of int64.
inline std::int64_t time_between(std::int64_t from_ns, std::int64_t to_ns) {
    std::int64_t found = 0;
    if (!__builtin_sub_overflow(to_ns, from_ns, &found)) return found;
    return to_ns < from_ns ? std::numeric_limits<std::int64_t>::min()
                           : std::numeric_limits<std::int64_t>::max();
}

class PortWatch {
  public:
    explicit PortWatch(const PortTimes& times) : times_(times) {}

    bool is_refused() const { return is_refused_; }
    // Number of bytes that came since the last readable frame, or since the last silence of the port.
    std::int64_t unread_bytes() const { return unread_bytes_; }

    void on_opened(std::int64_t host_ns) {
        is_connected_ = true;
        is_refused_ = heard_hello_ = false;
        forgive(host_ns);
    }
    void on_failed() { is_connected_ = false; }

    // Begins again to measure the times after which a trouble is reported. Bytes that came before `now_ns`
    // and are passed to on_bytes() later do not change this.
    void forgive(std::int64_t now_ns) {
        forgiven_ns_ = opened_ns_ = byte_ns_ = now_ns;
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
    // Call this if all received bytes were parts of readable frames.
    void on_all_read() { has_unread_ = false; }
    // Call this if the newest received bytes are not part of a readable frame so far. `bytes`: number of
    // these bytes.
    // `since_ns`: time at which the first of them came.
    void on_read_but(std::int64_t bytes, std::int64_t since_ns) {
        has_unread_ = true;
        unread_since_ns_ = since_ns;
        unread_bytes_ = bytes;
    }

    // Whether the port is open, its device has sent a HELLO, and no trouble can become due in the second
    // after `until_ns`.
    bool is_settled(std::int64_t until_ns) const {
        const std::int64_t unread_ns = has_unread_ ? time_between(unread_since_ns_, until_ns) : 0;
        return is_connected_ && heard_hello_ && !is_refused_ && unread_ns < times_.silence_ns - kSecondNs;
    }

    // Returns the present trouble of the port if it has to be reported, otherwise PortTrouble::none.
    PortTrouble check(std::int64_t now_ns) {
        const PortTrouble found = trouble_of(now_ns);
        const bool is_due = found != PortTrouble::none && is_news(trouble_name(found), now_ns);
        return is_due ? found : PortTrouble::none;
    }

    // Whether a trouble has to be reported. It has to be if it differs from the last reported trouble, or if
    // that report was made long ago. The trouble then counts as reported from now on.
    bool is_news(const char* kind, std::int64_t now_ns) {
        if (reported_ == kind && time_between(reported_ns_, now_ns) <= times_.repeat_ns) return false;
        reported_ = kind;
        reported_ns_ = now_ns;
        return true;
    }

  private:
    PortTrouble trouble_of(std::int64_t now_ns) const {
        const auto is_long = [&](std::int64_t since_ns) {
            return time_between(std::max(since_ns, forgiven_ns_), now_ns) >= times_.silence_ns;
        };
        if (!is_connected_) return PortTrouble::none;
        if (is_long(byte_ns_)) return PortTrouble::silent;
        if (has_unread_) return is_long(unread_since_ns_) ? PortTrouble::no_valid_frame : PortTrouble::none;
        const bool waits = !heard_hello_ && !is_refused_;
        return waits && is_long(opened_ns_) ? PortTrouble::no_hello : PortTrouble::none;
    }

    PortTimes times_;
    bool is_connected_ = false, is_refused_ = false, heard_hello_ = false;
    bool has_unread_ = false;       // whether bytes have come that are not part of any readable frame so far
    std::int64_t forgiven_ns_ = 0;  // time of the last call of forgive()
    std::int64_t opened_ns_ = 0, byte_ns_ = 0, unread_since_ns_ = 0, unread_bytes_ = 0;
    // kind of the last reported trouble; if it is empty, the next trouble of any kind is reported
    std::string reported_;
    std::int64_t reported_ns_ = 0;
};

}  // namespace fltea
