// Reads many ports in a thread of its own: each read is stamped when it came, whatever else the program does.
//
// What came waits here until somebody takes it. Who takes is woken when the oldest byte of a port is as old
// as that port's latency, so how often that happens costs no stamp its truth.
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

// Is added to what the system says of Unix time: for tests of a clock that is set.
void shift_unix_clock(std::int64_t ns);

// What came from one port since it was last taken.
struct PortNews {
    int port = 0;
    std::vector<std::uint8_t> bytes;
    std::vector<PortRead> reads;
    std::int64_t overflow_bytes = 0;  // read and thrown away, because too much waited
    int error = 0;                    // not 0: the port was lost behind these bytes, with this errno
    Stamp lost = {};
};

// Methods may be called from any thread; `take` from one at a time.
class PortReader {
  public:
    // capacity: bytes that may wait of one port, those that note its reads included.
    explicit PortReader(std::size_t capacity);
    ~PortReader();
    PortReader(const PortReader&) = delete;
    PortReader& operator=(const PortReader&) = delete;

    // Begins to read a descriptor that does not block. It stays the caller's, who closes it once the port is
    // lost or the reader closed. port: a number from 0 on, that of no other port that is read. closes: an
    // empty read means that the other side has closed, as of a socket. Throws std::system_error if it cannot
    // be waited for.
    void add(int port, int descriptor, bool closes, std::int64_t latency_ns);

    // Waits until something is due, `wake` or the timeout, and returns the time and, in `news`, all that came
    // until then. A port that is lost is due at once, and read no more.
    std::int64_t take(double timeout_s, std::vector<PortNews>& news);

    // Ends a `take` that waits, or else the next one.
    void wake();

    // Stops reading; nothing more is due.
    void close();

  private:
    struct Port {
        int descriptor = -1;
        bool closes = false;
        std::int64_t latency_ns = 0;
        bool changed = false;  // there is news
        PortNews news;
    };

    void run();
    bool read_port(std::size_t port, bool hung_up, std::uint8_t* buffer);
    void note(Port& port, std::int64_t due_ns);
    int wait_ms();
    void tell_if_due();

    const std::size_t capacity_;
    const int owner_;  // the process; one that is forked from it has no thread to wait for
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
