// Processes all devices on serial ports in rounds. A round processes what has come from each port, up to the
// first thing that the caller has to handle, such as a new HELLO (PortStop).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "port_reader.hpp"
#include "port_stream.hpp"

namespace fltea {

// A port for which the caller has to do something. `stop` says what the caller has to do.
struct Happened {
    int port;
    PortStop stop;
};

// Describes the part of a text that has the printed records of one device. `records`: number of these
// records. `arrived_ns`: arrival time of the newest bytes that were processed.
struct PrintedPart {
    std::int64_t arrived_ns;
    std::size_t records;
};

// A text with the printed records of all devices whose records are printed in the same format.
struct Text {
    std::vector<char> bytes;
    std::vector<PrintedPart> parts;
};

class Round {
  public:
    // `capacity`: number of bytes that may wait for each port (PortReader). `tick_ns`: time without bytes
    // after which a port gets a tick. `texts`: number of texts, one for each format in which records are
    // printed. A device has one printer for each text, or no printers.
    Round(std::size_t capacity, std::int64_t tick_ns, std::size_t texts)
        : reader_(capacity), tick_ns_(tick_ns), texts_(texts) {}

    PortReader& reader() { return reader_; }
    PortStream& stream(std::size_t port) { return *ports_[port].stream; }
    std::size_t size() const { return ports_.size(); }

    void add(std::unique_ptr<PortStream> stream, std::vector<RunPrinter*>* printers,
             std::int64_t latency_ns) {
        ports_.push_back({std::move(stream), printers, latency_ns, stamp_now().host_ns + tick_ns_});
    }

    // Call this when the port was opened or failed. The time until the port's next tick is counted from
    // `now_ns`.
    void touch(std::size_t port, std::int64_t now_ns) { ports_[port].tick_ns = now_ns + tick_ns_; }
    // Call this when the port is not needed any more.
    void end(std::size_t port) { ports_[port].has_ended = true; }

    // First continues with the ports at which the last round stopped, because the caller has handled them. If
    // there is nothing new for the caller after that, waits until bytes come, a port is due for a tick (an
    // item kTick), rows have to be fetched, another thread wakes it, or the timeout passes; then processes
    // what has come. Writes to `happened` one entry for each port for which the caller has to do something.
    void run(double timeout_s, std::vector<Happened>& happened) {
        std::int64_t now_ns = stamp_now().host_ns;
        for (std::size_t port = 0; port < ports_.size(); ++port) {
            if (ports_[port].is_left) run(port, now_ns, happened);
        }
        const bool has_text =
            std::any_of(texts_.begin(), texts_.end(), [](const Text& text) { return !text.bytes.empty(); });
        if (!happened.empty() || has_text) return;
        news_.clear();
        now_ns = reader_.take(std::min(timeout_s, double(due_ns() - now_ns) * 1e-9), news_);
        for (PortNews& one : news_) take(one, now_ns, happened);
        for (std::size_t port = 0; port < ports_.size(); ++port) {
            Port& one = ports_[port];
            if (one.has_ended || one.is_left) continue;
            const bool ticks = now_ns >= one.tick_ns;
            if (ticks) {
                one.tick_ns = now_ns + tick_ns_;
                one.stream->tick(now_ns);
            }
            if (ticks || now_ns >= one.stream->due_ns()) run(port, now_ns, happened);
        }
    }

    // The error with which the stream of a port has ended (kFault).
    const std::string& fault(std::size_t port) const { return ports_[port].fault; }
    std::vector<Text>& texts() { return texts_; }
    // Longest time that bytes have waited in addition to the latency of their port.
    std::int64_t waited_ns() const { return waited_ns_; }
    void forget_waited() { waited_ns_ = 0; }

  private:
    struct Port {
        std::unique_ptr<PortStream> stream;
        std::vector<RunPrinter*>* printers;
        std::int64_t latency_ns, tick_ns;  // `tick_ns`: time at which the port gets a tick if it stays silent
        bool has_ended = false;
        std::string fault = {};
        // whether the round stopped at this port for the caller to do something; bytes of the port may still
        // wait to be processed
        bool is_left = false;
    };

    void take(PortNews& news, std::int64_t now_ns, std::vector<Happened>& happened) {
        const auto port = static_cast<std::size_t>(news.port);
        if (port >= ports_.size() || ports_[port].has_ended) return;
        Port& one = ports_[port];
        if (!news.reads.empty()) {
            const std::int64_t due_ns = news.reads.front().stamp.host_ns + one.latency_ns;
            waited_ns_ = std::max(waited_ns_, now_ns - due_ns);
            one.tick_ns = news.reads.back().stamp.host_ns + tick_ns_;
        }
        one.stream->give(std::move(news), now_ns);
        run(port, now_ns, happened);
    }

    void run(std::size_t port, std::int64_t now_ns, std::vector<Happened>& happened) {
        Port& one = ports_[port];
        if (one.has_ended) {
            one.is_left = false;
            return;
        }
        PortStop stop = PortStop::kFault;
        try {
            stop = one.stream->run(now_ns);
        } catch (const std::exception& error) {  // an error of one device does not stop the others
            one.fault = error.what();
            one.has_ended = true;
        }
        one.is_left = stop != PortStop::kNothing;
        for (std::size_t text = 0; text < one.printers->size() && text < texts_.size(); ++text) {
            RunPrinter& printer = *(*one.printers)[text];
            if (printer.size() == 0) continue;
            Text& to = texts_[text];
            to.bytes.insert(to.bytes.end(), printer.data(), printer.data() + printer.size());
            to.parts.push_back({one.stream->now_ns(), printer.records()});
            printer.clear();
        }
        if (one.is_left) happened.push_back({static_cast<int>(port), stop});
    }

    std::int64_t due_ns() const {
        std::int64_t due = Device::kNever;
        for (const Port& one : ports_) {
            if (!one.has_ended) due = std::min(due, std::min(one.tick_ns, one.stream->due_ns()));
        }
        return due;
    }

    PortReader reader_;
    std::int64_t tick_ns_, waited_ns_ = 0;
    std::vector<Port> ports_;
    std::vector<PortNews> news_;
    std::vector<Text> texts_;
};

}  // namespace fltea
