// Reads many serial ports in a separate thread. Each read gets a time stamp when its bytes arrive, whatever
// the rest of the program does.
//
// Received bytes wait in the reader until take() fetches them. take() returns when the oldest waiting byte of
// a port has waited for the latency that was set for that port. Waiting does not affect the time stamps.
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

// What came from a port since the last call of take().
struct PortNews {
    int port = 0;
    std::vector<std::uint8_t> bytes;
    std::vector<PortRead> reads;
    // number of bytes that were read but discarded, because too many bytes were waiting
    std::int64_t overflow_bytes = 0;
    int error = 0;  // error number with which the port was lost after these bytes; 0 if the port was not lost
    Stamp lost = {};
};

// All methods may be called from any thread. Only one thread at a time may call take().
class PortReader {
  public:
    // `capacity`: number of bytes that may wait for each port, including the memory for the time stamps of
    // the reads.
    explicit PortReader(std::size_t capacity);
    ~PortReader();
    PortReader(const PortReader&) = delete;
    PortReader& operator=(const PortReader&) = delete;

    // Begins to read a port through its descriptor, which must be non-blocking. The caller owns the
    // descriptor, and has to close it after the port is lost or this reader is closed. `port`: index of the
    // port, counted from 0; each port has another index.
    // `closes`: whether an empty read means that the other side has closed the connection, as for a socket.
    // Throws std::system_error if epoll does not accept the descriptor.
    void add(int port, int descriptor, bool closes, std::int64_t latency_ns);

    // Waits until the oldest waiting byte of a port has waited for the port's latency, until a port is lost,
    // until wake() is called, or until the timeout passes. Returns the time at the end of the wait, and
    // writes everything that has arrived by then to `news`. A lost port is no longer read.
    std::int64_t take(double timeout_s, std::vector<PortNews>& news);

    // Ends the wait in the present call of take(). If no call of take() is waiting, the next one returns at
    // once.
    void wake();

    // Stops reading all ports. After this call, take() returns nothing new.
    void close();

  private:
    struct Port {
        int descriptor = -1;
        bool closes = false;
        std::int64_t latency_ns = 0;
        bool changed = false;  // whether there is anything in `news`
        PortNews news;
    };

    void run();
    bool read_port(std::size_t port, bool hung_up, std::uint8_t* buffer);
    void note(Port& port, std::int64_t due_ns);
    int wait_ms();
    void tell_if_due();

    const std::size_t capacity_;
    // ID of the process that created the reader; a process that was forked from it does not have the reading
    // thread
    const int owner_;
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
