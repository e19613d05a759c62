// Reads many ports in a thread of its own. Each read gets its time stamp on arrival, whatever the rest of the
// program does.
//
// Received bytes wait here until `take` fetches them. `take` returns when the oldest byte of a port is as old
// as that port's latency. Waiting does not affect the time stamps.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "descriptor.hpp"
#include "port_read.hpp"
#include "wake_up.hpp"

namespace fltea {

Stamp stamp_now();

// Adds `ns` to the system's Unix time, for tests in which the clock is set.
void shift_unix_clock(std::int64_t ns);

// What a port delivered since the last `take`.
struct PortNews {
    int port = 0;
    std::vector<std::uint8_t> bytes;
    std::vector<PortRead> reads;
    std::int64_t overflow_bytes = 0;  // discarded after reading, because too many bytes were waiting
    int error = 0;                    // not 0: the port was lost after these bytes, with this errno
    Stamp lost = {};
};

// Methods may be called from any thread; `take` from only one thread at a time.
class PortReader {
  public:
    // `capacity`: number of bytes that may wait per port, including the memory of its read records.
    explicit PortReader(std::size_t capacity);
    ~PortReader();
    PortReader(const PortReader&) = delete;
    PortReader& operator=(const PortReader&) = delete;

    // Begins to read a non-blocking descriptor. The caller keeps the descriptor, and closes it after the port
    // is lost or this reader is closed. `port`: index of the port, from 0, not in use by another port.
    // `closes`: an empty read means that the other side closed, as for a socket. Throws std::system_error if
    // epoll does not accept the descriptor.
    void add(int port, int descriptor, bool closes, std::int64_t latency_ns);

    // Waits until a port is due, `wake` is called or the timeout passes. Returns the time and, in `news`,
    // everything that arrived until then. A port that is lost is due at once and no longer read.
    std::int64_t take(double timeout_s, std::vector<PortNews>& news);

    // Ends a `take` that waits, or else the next `take`.
    void wake();

    // Stops reading. No port becomes due afterwards.
    void close();

  private:
    struct Port {
        int descriptor = -1;
        bool closes = false;
        std::int64_t latency_ns = 0;
        bool changed = false;  // `news` is not empty
        PortNews news;
    };

    void run();
    bool read_port(std::size_t port, bool hung_up, std::uint8_t* buffer);
    void note(Port& port, std::int64_t due_ns);
    int wait_ms();
    void tell_if_due();

    const std::size_t capacity_;
    const int owner_;  // process that created it; a forked process has no thread to join
    const Descriptor epoll_;
    const WakeUp close_;
    std::mutex mutex_;
    std::condition_variable due_;
    std::vector<std::unique_ptr<Port>> ports_;
    std::int64_t due_ns_;
    bool ready_ = false;
    bool closed_ = false;
    std::thread thread_;
};

}  // namespace fltea
