// Tests of the reader of serial ports under sanitizers. Pipes, sockets and pseudo-terminals take the place of
// boards.
#include <doctest/doctest.h>
#include <fcntl.h>
#include <pty.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <termios.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <map>
#include <memory>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "port_reader.hpp"

using fltea::PortNews;
using fltea::PortReader;

namespace {

constexpr double kPatience_s = 20.0;
constexpr std::int64_t kMs = 1'000'000;

// Both ends of a connection that stands for a serial port: the reader reads from `near`, and tests write to
// `far`.
struct Ends {
    int near = -1, far = -1;
    bool closes = false;

    ~Ends() {
        ::close(near);
        hang_up();
    }
    void hang_up() {
        if (far >= 0) ::close(far);
        far = -1;
    }
    // Waits until the reader has read all bytes from a pipe or socket. With a terminal, further bytes may
    // arrive later.
    void wait_until_read() const {
        for (int left = 1; left > 0;) REQUIRE(ioctl(near, FIONREAD, &left) == 0);
    }
    void send(const std::string& bytes) const {
        REQUIRE(::write(far, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size()));
    }
};

using Made = std::unique_ptr<Ends>;

Made made(int near, int far, bool closes) {
    Made ends(new Ends);
    ends->near = near;
    ends->far = far;
    ends->closes = closes;
    REQUIRE(fcntl(near, F_SETFL, O_NONBLOCK) == 0);
    return ends;
}

Made pipe_ends() {
    int both[2];
    REQUIRE(pipe(both) == 0);
    return made(both[0], both[1], false);
}

Made socket_ends() {
    int both[2];
    REQUIRE(socketpair(AF_UNIX, SOCK_STREAM, 0, both) == 0);
    return made(both[0], both[1], true);
}

Made terminal_ends() {
    int far = -1, near = -1;
    termios raw = {};
    cfmakeraw(&raw);
    raw.c_cc[VMIN] = raw.c_cc[VTIME] = 0;
    REQUIRE(openpty(&far, &near, nullptr, &raw, nullptr) == 0);
    return made(near, far, false);
}

// Collects all bytes that the reader gives for each port.
struct Heard {
    PortReader& reader;
    std::map<int, std::string> bytes = {};
    std::map<int, int> errors = {};
    std::map<int, std::int64_t> overflow_bytes = {};
    std::size_t reads = 0;
    std::int64_t last_ns = 0;

    // Calls the reader's take() once, and checks that its results are consistent.
    std::vector<PortNews> take(double timeout_s = kPatience_s) {
        std::vector<PortNews> news;
        const std::int64_t now_ns = reader.take(timeout_s, news);
        for (const PortNews& one : news) {
            std::int64_t end = 0, before_ns = 0;
            for (const fltea::PortRead& read : one.reads) {
                CHECK(read.end > end);
                CHECK(read.stamp.host_ns >= before_ns);
                // The caller counts a port as silent up to the time that take() returned. So every read of
                // the next call has to be later than that time.
                CHECK(read.stamp.host_ns > last_ns);
                CHECK(read.stamp.host_ns <= now_ns);
                end = read.end;
                before_ns = read.stamp.host_ns;
            }
            CHECK(end == static_cast<std::int64_t>(one.bytes.size()));
            CHECK(!errors.count(one.port));
            bytes[one.port].append(one.bytes.begin(), one.bytes.end());
            if (one.error) errors[one.port] = one.error;
            overflow_bytes[one.port] += one.overflow_bytes;
            reads += one.reads.size();
        }
        last_ns = now_ns;
        return news;
    }

    template <typename Condition>
    void until(Condition condition) {
        const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kPatience_s);
        while (!condition()) {
            REQUIRE(std::chrono::steady_clock::now() < end);
            take(0.05);
        }
    }
};

}  // namespace

TEST_CASE("port reader: the last bytes come before the loss, of every kind of port") {
    Made kinds[] = {pipe_ends(), socket_ends(), terminal_ends()};
    const int errors[] = {EIO, ECONNRESET, EIO};
    for (int k = 0; k < 3; ++k) {
        PortReader reader(1 << 20);
        Heard heard{reader};
        Ends& ends = *kinds[k];
        reader.add(5, ends.near, ends.closes, 0);
        ends.send("first");
        heard.until([&] { return heard.bytes[5] == "first"; });
        ends.send("last words");
        // a terminal (k = 2) may discard bytes that were not read before it hangs up
        if (k != 2) ends.hang_up();
        heard.until([&] { return heard.bytes[5] == "firstlast words"; });
        ends.hang_up();
        heard.until([&] { return heard.errors.count(5) == 1; });
        CHECK(heard.errors[5] == errors[k]);
        Made again = pipe_ends();  // the same port (number 5), opened again
        reader.add(5, again->near, false, 0);
        heard.errors.clear();
        again->send("back");
        heard.until([&] { return heard.bytes[5] == "firstlast wordsback"; });
    }
}

TEST_CASE("port reader: each read keeps its stamp, and all wait until the oldest is due") {
    PortReader reader(1 << 20);
    Heard heard{reader};
    Made ends = pipe_ends();
    reader.add(0, ends->near, false, 1000 * kMs);
    const std::int64_t begin_ns = fltea::stamp_now().host_ns;
    ends->send("one");
    ends->wait_until_read();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    ends->send("two");
    const std::vector<PortNews> news = heard.take();
    REQUIRE(news.size() == 1);
    REQUIRE(news[0].reads.size() == 2);
    CHECK(news[0].reads[0].end == 3);
    CHECK(news[0].reads[0].stamp.host_ns > begin_ns);
    CHECK(news[0].reads[1].stamp.host_ns > news[0].reads[0].stamp.host_ns);
    CHECK(heard.last_ns >= news[0].reads[0].stamp.host_ns + 1000 * kMs);
}

TEST_CASE("port reader: a port without patience brings the others along") {
    PortReader reader(1 << 20);
    Heard heard{reader};
    Made patient = pipe_ends(), prompt = pipe_ends();
    reader.add(0, patient->near, false, 3600'000 * kMs);
    reader.add(1, prompt->near, false, 0);
    patient->send("waits");
    heard.take(0.01);
    prompt->send("now");
    heard.until([&] { return heard.bytes[1] == "now"; });
    CHECK(heard.bytes[0] == "waits");
}

TEST_CASE("port reader: what does not fit is counted, and what came before it stays") {
    PortReader reader(1000);
    Heard heard{reader};
    Made ends = pipe_ends();
    reader.add(0, ends->near, false, 3600'000 * kMs);
    // Sizes of three texts, for a reader that holds at most 1,000 bytes. It keeps the first text. At least
    // one of the others does not fit beside it, and is discarded and counted.
    for (const std::size_t size : {900, 700, 700}) {
        ends->send(std::string(size, size == 900 ? 'a' : 'b'));
        ends->wait_until_read();
    }
    heard.until(
        [&] { return heard.bytes[0].size() + static_cast<std::size_t>(heard.overflow_bytes[0]) == 2300; });
    CHECK(heard.overflow_bytes[0] >= 700);
    CHECK(heard.bytes[0].substr(0, 900) == std::string(900, 'a'));
    ends->send("fits again");
    heard.until([&] { return heard.bytes[0].find("fits again") != std::string::npos; });
}

TEST_CASE("port reader: wake ends a take that waits, and one that has not begun") {
    PortReader reader(1 << 20);
    Heard heard{reader};
    reader.wake();
    CHECK(heard.take().empty());
    std::thread other([&reader] {
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        reader.wake();
    });
    CHECK(heard.take().empty());
    other.join();
}

TEST_CASE("port reader: closing ends a take that waits, and can be done twice") {
    PortReader reader(1 << 20);
    Heard heard{reader};
    Made ends = pipe_ends();
    reader.add(0, ends->near, false, 0);
    std::thread other([&reader] {
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
        reader.close();
    });
    CHECK(heard.take().empty());
    other.join();
    reader.close();
    CHECK(heard.take().empty());
    CHECK_THROWS_AS(reader.add(1, ends->near, false, 0), std::system_error);
}

TEST_CASE("port reader: what cannot be waited for is refused") {
    PortReader reader(1 << 20);
    char name[] = "/tmp/port_reader_XXXXXX";
    const int file = mkstemp(name);
    unlink(name);
    CHECK_THROWS_AS(reader.add(0, file, false, 0), std::system_error);
    ::close(file);
    CHECK_THROWS_AS(reader.add(0, file, false, 0), std::system_error);
}

TEST_CASE("port reader: many ports that many threads write to lose nothing") {
    constexpr int kPorts = 40, kWriters = 4, kRounds = 100;
    PortReader reader(1 << 20);
    Heard heard{reader};
    std::vector<Made> ports;
    for (int k = 0; k < kPorts; ++k) {
        ports.push_back(k % 2 ? pipe_ends() : socket_ends());
        reader.add(k, ports.back()->near, ports.back()->closes, (k % 3) * kMs);
    }
    std::vector<std::thread> writers;
    for (int writer = 0; writer < kWriters; ++writer) {
        writers.emplace_back([&ports, writer] {
            for (int round = 0; round < kRounds; ++round) {
                for (std::size_t k = static_cast<std::size_t>(writer); k < kPorts; k += kWriters) {
                    const std::string text = std::to_string(round) + ",";
                    // plain checks are used, because assertions of doctest in several threads would take
                    // longer than the code under test
                    if (::write(ports[k]->far, text.data(), text.size()) < 0) std::abort();
                }
            }
        });
    }
    std::string expected;
    for (int round = 0; round < kRounds; ++round) expected += std::to_string(round) + ",";
    heard.until([&] {
        for (int k = 0; k < kPorts; ++k) {
            if (heard.bytes[k] != expected) return false;
        }
        return true;
    });
    for (std::thread& writer : writers) writer.join();
    CHECK(heard.errors.empty());
}

TEST_CASE("port reader: a forked process can end without the thread, which it does not have") {
    PortReader* reader = new PortReader(1 << 20);
    const pid_t child = fork();
    if (child == 0) {
        delete reader;
        _exit(7);
    }
    int status = 0;
    REQUIRE(waitpid(child, &status, 0) == child);
    CHECK((WIFEXITED(status) && WEXITSTATUS(status) == 7));
    delete reader;
}

TEST_CASE(
    "port reader: a port that was ready and yet empty, as another program took its bytes, is not lost") {
    int both[2];
    // this kind of socket can deliver empty datagrams
    REQUIRE(socketpair(AF_UNIX, SOCK_DGRAM, 0, both) == 0);
    Made ends = made(both[0], both[1], false);
    PortReader reader(1 << 20);
    Heard heard{reader};
    reader.add(0, ends->near, false, 0);
    for (const char* text : {"", "ours", "", " too"}) ends->send(text);
    heard.until([&] { return heard.bytes[0] == "ours too"; });
    CHECK(heard.errors.empty());
    CHECK(heard.reads == 2);
}
