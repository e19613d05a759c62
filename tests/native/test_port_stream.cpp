// Tests of PortStream under sanitizers. Some callers want the samples in blocks, and others as JSON lines.
// Each caller gets everything once and in order. This does not depend on how the bytes are divided into
// reads, nor on how long rows wait for more rows.
#include <doctest/doctest.h>

#include <cstdlib>
#include <cstring>
#include <memory>
#include <random>
#include <string>

#include "port_decoder_rig.hpp"
#include "port_stream.hpp"

using namespace fltea;
using namespace port_decoder_rig;

namespace {

using Random = std::mt19937;

unsigned below(Random& random, unsigned end) { return static_cast<unsigned>(random() % end); }

// A tracker for tests, which reports a step at each sample whose value on the first axis is 0. Its estimates
// have no meaning.
struct Parts : TrackerPart, BankPart {
    void run(const double* y, const double*, std::size_t, std::size_t rows, double* out, std::uint8_t* moving,
             std::vector<track::TrackerEvent>& events) override {
        std::fill_n(out, kTrackedColumns * rows * 2, 0.0);
        std::fill_n(moving, rows * 2, std::uint8_t(0));
        for (std::size_t i = 0; i < rows; ++i) {
            if (y[2 * i] != 0) continue;
            track::TrackerEvent event = {};
            event.row = i;
            event.kind = track::TrackerEvent::kStep;
            events.push_back(event);
        }
    }
    void skip_rows(std::uint64_t) override {}
    void run(const double*, std::size_t rows, const BankBlock& out, std::vector<Lost>&) override {
        for (double* column : out.columns) std::fill_n(column, rows * 2, 0.0);
        std::fill_n(out.valid, rows * 2, std::uint8_t(0));
        std::fill_n(out.white, rows * 2, std::uint8_t(0));
    }
    void skip_rows(std::uint64_t, std::vector<Lost>&) override {}
};

// Returns random bytes with their arrival times: samples at 100 Hz with gaps, repeats and jumps, HELLOs,
// faults, and invalid bytes.
Reads story(Random& random) {
    Reads found;
    std::uint32_t boot = 5, sequence = below(random, 65'536), us = static_cast<std::uint32_t>(random());
    std::int64_t now_ns = kSecondNs;
    Bytes bytes = Bytes{0} + hello(boot);
    for (int k = 0; k < 400; ++k) {
        const unsigned what = below(random, 60);
        if (what == 0) bytes = bytes + hello(boot);
        if (what == 1) bytes = bytes + hello(boot = 5 + below(random, 9));
        if (what == 2) bytes = bytes + fault();
        if (what == 3) bytes = bytes + Bytes{1, 2, 3, 0};
        unsigned step = what == 4 ? below(random, 60) : 1;
        if (what == 5) us = static_cast<std::uint32_t>(random());
        sequence += step;
        us += 10'000 * step;
        now_ns += step * 10 * kMs;
        Sample one = {};
        one.gyro_x = static_cast<std::int16_t>(below(random, 40));
        std::uint8_t wire[kMaxWire];
        const std::size_t n = encode_message(one, static_cast<std::uint16_t>(sequence), us, wire);
        bytes.insert(bytes.end(), wire, wire + n);
        if (below(random, 4) != 0) continue;
        const std::size_t left = std::min<std::size_t>(below(random, 9), bytes.size() - 1);
        found.add(Bytes(bytes.begin(), bytes.end() - static_cast<std::ptrdiff_t>(left)), now_ns);
        bytes.erase(bytes.begin(), bytes.end() - static_cast<std::ptrdiff_t>(left));
        if (below(random, 50) == 0) now_ns += 700 * kMs;
    }
    return found.add(bytes, now_ns);
}

std::string word(const char* what, double number) {
    char text[60];
    std::snprintf(text, sizeof text, "%s %g", what, number);
    return text;
}

// A caller that receives the samples of a port in blocks and as JSON lines, and all other events.
class Taker {
  public:
    Words blocks, lines;
    Bytes bytes;

    Taker(bool rows, bool text, bool reads, std::int64_t patience_ns) {
        stream_.wants_rows = rows;
        stream_.wants_text = text;
        stream_.wants_reads = reads;
        stream_.patience_ns = patience_ns;
        wire_.opened({0, 1});
        device_.stats_due_ns = 0;
    }

    void give(const Reads& all, std::size_t begin, std::size_t end, bool is_last) {
        PortNews news;
        const std::int64_t from = begin == 0 ? 0 : all.reads[begin - 1].end;
        news.bytes.assign(all.bytes.begin() + from, all.bytes.begin() + all.reads[end - 1].end);
        for (std::size_t k = begin; k < end; ++k)
            news.reads.push_back({all.reads[k].end - from, all.reads[k].stamp});
        const std::int64_t now_ns = all.reads[end - 1].stamp.host_ns;
        if (is_last) news.error = 5;
        given_ += news.bytes.size();
        stream_.give(std::move(news), now_ns);
        take_all(now_ns);
    }
    const Device& device() const { return device_; }

  private:
    void take_all(std::int64_t now_ns) {
        for (PortStop stop = PortStop::kItem; stop != PortStop::kNothing;) {
            stop = stream_.run(now_ns);
            for (RunPrinter* one : printers_) {
                print(std::string(one->data(), one->size()));
                one->clear();
            }
            take(stop);
        }
    }
    void take(PortStop stop) {
        if (stop == PortStop::kItem) on_item(stream_.item());
        if (stop == PortStop::kStop) on_stop(stream_.advanced());
        if (stop == PortStop::kLost) say("lost");
        if (stop == PortStop::kRows) on_rows();
        if (stop == PortStop::kReads) {
            bytes = bytes + stream_.reads().bytes;
            stream_.reads() = PortNews();
        }
    }
    void say(const std::string& what) {
        blocks.push_back(what);
        lines.push_back(what);
    }
    void print(const std::string& text) {
        for (const char* at = text.c_str(); *at != '\0';) {
            char* end = nullptr;
            const double seq = std::strtod(at, &end);
            lines.push_back(word(std::to_string(std::int64_t(seq)).c_str(), std::strtod(end, &end)));
            at = end + 1;
        }
    }
    void on_rows() {
        RunRows& rows = stream_.rows();
        const auto* const seq = reinterpret_cast<const std::int64_t*>(rows.column(1).data());
        const auto* const gyro = reinterpret_cast<const double*>(rows.column(4).data());
        for (std::size_t i = 0; i < rows.rows(); ++i) {
            const std::string one = word(std::to_string(seq[i]).c_str(), gyro[3 * i]);
            if (stream_.wants_rows) blocks.push_back(one);
            if (stream_.is_unprinted()) lines.push_back(one);
        }
        if (stream_.is_unprinted()) {
            const auto text = std::make_shared<const LinePrinter>(
                Words{"", " ", "\n"}, std::vector<LinePrinter::Hole>{{0, 0}, {3, 0}}, true);
            printer_ = std::make_unique<RunPrinter>(text, 1, 1, rows.shape());
            printers_ = {printer_.get()};
        }
        rows.clear();
    }
    void on_item(const PortItem& item) {
        say("item " + std::to_string(item.kind) + " at " + std::to_string(item.host_ns));
        if (item.kind == PortItem::kTick) device_.stats_due_ns = item.host_ns + kSecondNs;
        if (item.kind != PortItem::kFrame || item.type != Hello::type()) return;
        if (stream_.wants_reads) CHECK(bytes.size() == given_);
        const std::uint8_t boot = item.bytes[6];
        if (boot == 13) {  // this stands for a device whose HELLO is refused
            wire_.refuse_hello();
            device_.place.forget_hello();
            return;
        }
        wire_.accept_hello();
        device_.place.on_hello(100, 50, boot != boot_, false);
        device_.scales = {1.0 + boot % 2, boot % 3 != 0, 1, 1, 0};
        boot_ = boot;
    }
    void on_stop(const Advanced& found) {
        say("stop " + std::to_string(static_cast<int>(found.stop)) + " at " +
            std::to_string(stream_.stopped_ns()));
        if (found.stop == Stop::kStatsDue) device_.stats_due_ns = stream_.stopped_ns() + kSecondNs;
        if (found.stop == Stop::kFitDue) device_.fit_counts = device_.place.newest().seq + 7;
        if (found.stop == Stop::kFitCounts) device_.fit_due = device_.place.newest().seq + 11;
        if (found.stop == Stop::kEpoch) begin();
        // at these stops, the text that all JSON lines contain changes, so the objects that print the lines
        // are replaced
        if (found.stop == Stop::kEpoch || found.stop == Stop::kFitCounts) printers_.clear();
    }
    void begin() {
        Sensor one;
        one.places = {0, 2};
        one.tracker = &parts_;
        one.bank = &parts_;
        one.waits = {false, false};
        one.window_left = 20;
        device_.begin(0, {one});
        device_.fit_due = device_.judged().seq + 13;
    }

    PortDecoder wire_{kTimes};
    Device device_;
    std::vector<RunPrinter*> printers_;
    std::unique_ptr<RunPrinter> printer_;
    Parts parts_;
    PortStream stream_{wire_, device_, printers_};
    int boot_ = 0;
    std::size_t given_ = 0;
};

// Gives the reads of a port to a caller in groups of one to `most` reads. A group of several reads ends at
// most kStallNs after the group before it, so the caller never seems to have stood still.
void give_all(Taker& to, const Reads& all, Random& random, unsigned most) {
    for (std::size_t begin = 0; begin < all.reads.size();) {
        std::size_t end = std::min(all.reads.size(), begin + 1 + below(random, most));
        const std::int64_t before_ns = begin == 0 ? 0 : all.reads[begin - 1].stamp.host_ns;
        while (end > begin + 1 && all.reads[end - 1].stamp.host_ns - before_ns > PortDecoder::kStallNs) --end;
        to.give(all, begin, end, end == all.reads.size());
        begin = end;
    }
}

// Returns the position of the first difference between two lists of words, with both words. Returns an empty
// text if there is none.
std::string difference(const Words& one, const Words& other) {
    std::size_t k = 0;
    while (k < one.size() && k < other.size() && one[k] == other[k]) ++k;
    if (k == one.size() && k == other.size()) return "";
    const auto at = [k](const Words& words) { return k < words.size() ? words[k] : "nothing"; };
    return std::to_string(k) + ": " + at(one) + " for " + at(other);
}

}  // namespace

TEST_CASE("port stream: nothing is lost, doubled or overtaken, whatever the cuts and the patience") {
    std::size_t samples = 0;
    for (unsigned seed = 0; seed < 150; ++seed) {
        CAPTURE(seed);
        Random random(seed);
        const Reads all = story(random);
        Taker first(true, false, true, 0);
        give_all(first, all, random, 1);
        CHECK(first.bytes == all.bytes);
        samples += static_cast<std::size_t>(first.device().place.counts().delivered);
        for (const std::int64_t patience_ns : {std::int64_t(0), 30 * kMs, 600 * kMs}) {
            CAPTURE(patience_ns);
            for (const bool rows : {true, false}) {
                Taker other(rows, true, rows, patience_ns);
                give_all(other, all, random, 1 + below(random, 40));
                if (rows) CHECK(difference(other.blocks, first.blocks) == "");
                if (rows) CHECK(other.bytes == all.bytes);
                CHECK(difference(other.lines, first.blocks) == "");
                CHECK(other.device().place.counts().delivered == first.device().place.counts().delivered);
            }
        }
    }
    CHECK(samples > 10'000);
}
