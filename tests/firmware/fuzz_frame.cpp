// A libFuzzer test of frames. If the first byte of an input is even, the rest is a stream of bytes for the
// receiver. If the first byte is odd, the rest is a message and the damage that is done to its encoded frame.
// `fuzz_frame --seeds DIR` makes a corpus from the test vectors.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>

#include "frame.h"
#include "receiver.h"
#include "vectors.h"

namespace {

void check(bool holds, const char* what) {
    if (holds) return;
    std::fprintf(stderr, "does not hold: %s\n", what);
    std::abort();
}

Bytes encode(const Frame& frame) {
    Bytes wire(fltea::kMaxWire);
    wire.resize(fltea::encode_frame(frame.type, frame.sequence, frame.device_us, frame.payload.data(),
                                    frame.payload.size(), wire.data()));
    return wire;
}

bool same(const Frame& a, const Frame& b) {
    return a.type == b.type && a.sequence == b.sequence && a.device_us == b.device_us &&
           a.payload == b.payload;
}

// Decodes the payload of a frame into the struct of its message type, and encodes this struct again. The
// result has exactly the fields of this protocol version.
struct Again {
    Frame frame;
    Bytes wire;

    template <typename Message>
    void message() {
        frame.payload.resize(Message::size());
        wire.resize(fltea::wire_size<Message>());
        wire.resize(
            fltea::encode_message(message_of<Message>(frame), frame.sequence, frame.device_us, wire.data()));
    }
};

// Checks any stream of bytes. A frame has only one valid encoding, so the firmware's encoder has to give the
// same bytes for each accepted frame.
void any_stream(const uint8_t* data, size_t n) {
    Receiver receiver;
    Bytes block;
    int blocks = 0;
    for (size_t i = 0; i < n; ++i) {
        const size_t before = receiver.intact.size();
        const int judged = receiver.judged();
        receiver.feed(data[i]);
        block.push_back(data[i]);
        check(receiver.intact.size() <= before + 1, "one byte ends one frame at most");
        check(receiver.judged() <= judged + 1, "one byte ends one block at most");
        if (receiver.intact.size() > before) check(encode(receiver.intact.back()) == block, "one encoding");
        if (data[i] == 0) {
            blocks += block.size() > 1;
            block.clear();
        }
    }
    const bool open = !block.empty();
    check(receiver.judged() >= blocks && receiver.judged() <= blocks + open, "every block is judged once");
    check(receiver.frames.size() <= receiver.intact.size(), "frames are intact");
    for (const Frame& frame : receiver.frames) {
        Again again = {frame, {}};
        check(with_message(frame.type, again), "frames are of known types");
        check(again.wire == encode(again.frame), "a struct keeps every bit of its payload");
    }
}

// Splits the input into a header, a payload, and pairs (kind, position) of damage to the encoded frame.
void damaged_message(const uint8_t* data, size_t n) {
    if (n < 8) return;
    const size_t size = data[0] % (fltea::kMaxPayload + 1);
    if (n < 8 + size) return;
    const Frame sent = {data[1], static_cast<uint16_t>(little_endian(data + 2, 2)),
                        little_endian(data + 4, 4), Bytes(data + 8, data + 8 + size)};
    Bytes wire = encode(sent);
    check(wire.size() == size + 13 && wire.back() == 0, "size on the wire");
    for (size_t i = 8 + size; i + 1 < n; i += 2) {
        const size_t at = data[i + 1] % wire.size();
        switch (data[i] % 4) {
            case 0:
                wire[at] = static_cast<uint8_t>(wire[at] ^ (1u << (data[i] >> 5)));
                break;
            case 1:
                wire.insert(wire.begin() + static_cast<std::ptrdiff_t>(at), data[i]);
                break;
            case 2:
                if (wire.size() > 1) wire.erase(wire.begin() + static_cast<std::ptrdiff_t>(at));
                break;
            default:
                wire[at] = 0;
                break;
        }
    }
    Receiver receiver;
    receiver.feed(0);
    receiver.feed(wire.data(), wire.size());
    receiver.feed(0);
    // A payload may itself contain a valid frame. If damage puts zeros before and after this inner frame, the
    // receiver accepts the inner frame, and no checksum can detect that.
    const bool cut = std::find(wire.begin(), wire.end() - 1, 0) != wire.end() - 1;
    for (const Frame& frame : receiver.intact)
        check(cut || same(frame, sent), "accepted only if it is what was sent");
    if (8 + size + 1 >= n) check(receiver.intact.size() == 1, "undamaged: accepted");
}

void write_seed(const std::string& folder, int number, const Bytes& bytes) {
    std::ofstream file(folder + "/" + std::to_string(number), std::ios::binary);
    file.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    if (!file) std::exit(1);
}

void write_message(const std::string& folder, int number, size_t type, const Bytes& payload,
                   const Bytes& damage) {
    Bytes message = {1, static_cast<uint8_t>(payload.size()), static_cast<uint8_t>(type)};
    message.insert(message.end(), 6, 0x11);
    message.insert(message.end(), payload.begin(), payload.end());
    message.insert(message.end(), damage.begin(), damage.end());
    write_seed(folder, number, message);
}

// Writes inputs of three kinds: unchanged streams, messages from good frames without damage, and messages
// whose payload is a good frame. In the third kind, the damage puts a zero, which separates frames, before
// and after the inner frame.
void write_seeds(const std::string& folder) {
    int number = 0;
    for (const char* name : {"good.txt", "bad.txt", "streams.txt"}) {
        for (const Record& record : records(name)) {
            Bytes stream(1, 0);
            for (const std::pair<std::string, std::string>& line : record) {
                if (line.first != "wire" && line.first != "bytes") continue;
                const Bytes bytes = from_hex(line.second);
                stream.insert(stream.end(), bytes.begin(), bytes.end());
            }
            write_seed(folder, number++, stream);
        }
    }
    for (const Record& record : records("good.txt")) {
        write_message(folder, number++, std::stoul(value_of(record, "type")),
                      from_hex(value_of(record, "payload")), {});
        Bytes inner = from_hex(value_of(record, "wire"));
        inner.insert(inner.begin(), 1);
        inner.back() = 1;
        const uint8_t before = 8, after = static_cast<uint8_t>(before + inner.size() - 1), zero = 3;
        if (inner.size() > fltea::kMaxPayload || after < before) continue;
        write_message(folder, number++, 0x77, inner, {zero, before, zero, after});
    }
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
    if (*argc == 3 && std::string((*argv)[1]) == "--seeds") {
        write_seeds((*argv)[2]);
        std::exit(0);
    }
    return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t n) {
    if (n == 0) return 0;
    if (data[0] % 2 == 0) {
        any_stream(data + 1, n - 1);
    } else {
        damaged_message(data + 1, n - 1);
    }
    return 0;
}
