#include "port_reader.hpp"

#include <sys/epoll.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <ctime>
#include <limits>
#include <system_error>

namespace fltea {

namespace {

std::atomic<std::int64_t> unix_shift_ns{0};

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
// A Unix time after this is not taken for a real date. fltea.records.clock uses the same limit.
constexpr std::int64_t kEndOfDatesNs = 4'102'444'800 * 1'000'000'000;
constexpr std::size_t kMostBytes = 1 << 16;  // largest number of bytes in one read
// largest number of ports that one call of epoll_wait() reports as ready
constexpr int kMostPorts = 64;
constexpr std::uint64_t kClose = ~std::uint64_t{0};

// The clock for host times. It also runs while the machine sleeps, if the system has such a clock.
#ifdef CLOCK_BOOTTIME
constexpr clockid_t kClock = CLOCK_BOOTTIME;
#else
constexpr clockid_t kClock = CLOCK_MONOTONIC;
#endif

std::int64_t now_ns(clockid_t clock) {
    timespec now = {};
    clock_gettime(clock, &now);
    return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

std::system_error system_error(const char* what) { return {errno, std::generic_category(), what}; }

// Blocks all signals in this thread as long as the object exists. A thread that is started meanwhile also has
// them blocked. Signals therefore reach Python's own threads, which handle them.
class SignalsBlocked {
  public:
    SignalsBlocked() {
        sigset_t all;
        sigfillset(&all);
        pthread_sigmask(SIG_SETMASK, &all, &before_);
    }
    ~SignalsBlocked() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
    SignalsBlocked(const SignalsBlocked&) = delete;
    SignalsBlocked& operator=(const SignalsBlocked&) = delete;

  private:
    sigset_t before_ = {};
};

}  // namespace

Stamp stamp_now() {
    const std::int64_t host_ns = now_ns(kClock);
    const std::int64_t unix_ns = now_ns(CLOCK_REALTIME) + unix_shift_ns.load();
    return {host_ns, unix_ns >= 0 && unix_ns < kEndOfDatesNs ? unix_ns - host_ns : 0};
}

void shift_unix_clock(std::int64_t ns) { unix_shift_ns = ns; }

PortReader::PortReader(std::size_t capacity)
    : capacity_(capacity), owner_(getpid()), epoll_(epoll_create1(EPOLL_CLOEXEC)), due_ns_(kNever) {
    epoll_event event = {};
    event.events = EPOLLIN;
    event.data.u64 = kClose;
    if (epoll_ctl(epoll_.number(), EPOLL_CTL_ADD, close_.number(), &event) != 0) throw system_error("epoll");
    const SignalsBlocked blocked;
    thread_ = std::thread(&PortReader::run, this);
}

PortReader::~PortReader() { close(); }

void PortReader::add(int port, int descriptor, bool closes, std::int64_t latency_ns) {
    const std::lock_guard<std::mutex> alone(mutex_);
    const std::size_t at = static_cast<std::size_t>(port);
    if (closed_) throw std::system_error(EBADF, std::generic_category(), "the reader is closed");
    while (ports_.size() <= at) ports_.push_back(std::make_unique<Port>());
    Port& one = *ports_[at];
    epoll_event event = {};
    event.events = EPOLLIN;
    event.data.u64 = at;
    if (epoll_ctl(epoll_.number(), EPOLL_CTL_ADD, descriptor, &event) != 0) throw system_error("epoll_ctl");
    one.descriptor = descriptor;
    one.closes = closes;
    one.latency_ns = latency_ns;
}

std::int64_t PortReader::take(double timeout_s, std::vector<PortNews>& news) {
    std::unique_lock<std::mutex> alone(mutex_);
    due_.wait_for(alone, std::chrono::duration<double>(timeout_s), [this] { return ready_ || closed_; });
    ready_ = false;
    due_ns_ = kNever;
    for (std::size_t at = 0; at < ports_.size(); ++at) {
        Port& one = *ports_[at];
        if (!one.changed) continue;
        one.changed = false;
        news.push_back(std::move(one.news));
        news.back().port = static_cast<int>(at);
        one.news = PortNews();
    }
    // The time is taken while the mutex is locked, so that all reads of ports after this call have later time
    // stamps.
    return now_ns(kClock);
}

void PortReader::wake() {
    {
        const std::lock_guard<std::mutex> alone(mutex_);
        ready_ = true;
    }
    due_.notify_all();
}

void PortReader::close() {
    if (getpid() != owner_) {
        if (thread_.joinable()) thread_.detach();
        return;
    }
    {
        const std::lock_guard<std::mutex> alone(mutex_);
        if (closed_) return;
        closed_ = true;
        close_.ring();
    }
    due_.notify_all();
    thread_.join();
}

void PortReader::run() {
    const std::unique_ptr<std::uint8_t[]> buffer(new std::uint8_t[kMostBytes]);
    epoll_event events[kMostPorts];
    for (;;) {
        const int wait = wait_ms();
        if (wait < 0) return;
        const int count = epoll_wait(epoll_.number(), events, kMostPorts, wait);
        bool any = count <= 0;
        for (int k = 0; k < count; ++k) {
            const std::uint64_t at = events[k].data.u64;
            if (at == kClose) continue;
            const bool hung_up = (events[k].events & ~static_cast<std::uint32_t>(EPOLLIN)) != 0;
            any |= read_port(static_cast<std::size_t>(at), hung_up, buffer.get());
        }
        tell_if_due();
        // If none of the ready descriptors had any bytes, wait a little. This can happen if another program
        // reads from the same port.
        if (!any) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
}

// Reads one port. Returns whether bytes came or the port was lost.
bool PortReader::read_port(std::size_t at, bool hung_up, std::uint8_t* buffer) {
    Port* port = nullptr;
    int descriptor = -1;
    {
        const std::lock_guard<std::mutex> alone(mutex_);
        port = ports_[at].get();
        descriptor = port->descriptor;
    }
    const ssize_t size = ::read(descriptor, buffer, kMostBytes);
    int error = size < 0 ? errno : 0;
    if (error == EINTR) return true;
    const bool empty = size == 0 || error == EAGAIN || error == EWOULDBLOCK;
    if (empty) {
        if (port->closes && !error) {
            error = ECONNRESET;
        } else if (hung_up) {
            error = EIO;
        } else {
            return false;
        }
    }
    const std::lock_guard<std::mutex> alone(mutex_);
    PortNews& news = port->news;
    const Stamp stamp = stamp_now();
    if (error) {
        epoll_ctl(epoll_.number(), EPOLL_CTL_DEL, descriptor, nullptr);
        port->descriptor = -1;
        news.error = error;
        news.lost = stamp;
        note(*port, stamp.host_ns);
        return true;
    }
    const std::size_t n = static_cast<std::size_t>(size);
    const std::size_t kept = news.bytes.size() + (news.reads.size() + 1) * sizeof(PortRead);
    if (kept + n > capacity_) {
        news.overflow_bytes += size;
    } else {
        news.bytes.insert(news.bytes.end(), buffer, buffer + n);
        news.reads.push_back({static_cast<std::int64_t>(news.bytes.size()), stamp});
    }
    note(*port, stamp.host_ns + port->latency_ns);
    return true;
}

void PortReader::note(Port& port, std::int64_t due_ns) {
    port.changed = true;
    due_ns_ = std::min(due_ns_, due_ns);
}

// Returns how long to wait for bytes from the ports [ms], or -1 if the reader is closed.
int PortReader::wait_ms() {
    const std::lock_guard<std::mutex> alone(mutex_);
    if (closed_) return -1;
    constexpr std::int64_t kLongest = 60'000;
    if (due_ns_ == kNever) return kLongest;
    const std::int64_t left_ns = std::max<std::int64_t>(0, due_ns_ - now_ns(kClock));
    return static_cast<int>(std::min(kLongest, (left_ns + 999'999) / 1'000'000));
}

void PortReader::tell_if_due() {
    {
        const std::lock_guard<std::mutex> alone(mutex_);
        if (due_ns_ == kNever || now_ns(kClock) < due_ns_) return;
        due_ns_ = kNever;
        ready_ = true;
    }
    due_.notify_one();
}

}  // namespace fltea
