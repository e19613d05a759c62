// A libFuzzer test of the host's decoder. The first byte of an input is the seed for the sizes of the chunks,
// and the rest is the stream of bytes. The results must be those of tests/firmware/receiver.h, which was
// written from protocol/README.md alone. `fuzz_decoder --seeds DIR` makes a corpus from the test vectors.
#include <cstdio>
#include <cstdlib>

#include "../firmware/vectors.h"
#include "decoder_check.h"

namespace {

void write_seeds(const std::string& folder) {
    int number = 0;
    for (const char* name : {"good.txt", "bad.txt", "streams.txt"}) {
        for (const Record& record : records(name)) {
            Bytes seed(1, static_cast<uint8_t>(number));
            for (const std::pair<std::string, std::string>& line : record) {
                if (line.first != "wire" && line.first != "bytes") continue;
                const Bytes bytes = from_hex(line.second);
                seed.insert(seed.end(), bytes.begin(), bytes.end());
            }
            std::ofstream file(folder + "/" + std::to_string(number++), std::ios::binary);
            file.write(reinterpret_cast<const char*>(seed.data()), static_cast<std::streamsize>(seed.size()));
            if (!file) std::exit(1);
        }
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
    uint32_t state = data[0];
    const auto next_size = [&state] {
        state = state * 1664525u + 1013904223u;
        return static_cast<size_t>(state >> 24);
    };
    const std::string fault = compare_with_receiver(Bytes(data + 1, data + n), next_size);
    if (fault.empty()) return 0;
    std::fprintf(stderr, "differs from the receiver: %s\n", fault.c_str());
    std::abort();
}
