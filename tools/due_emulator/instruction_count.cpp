// What Unicorn calls at each block of code and before each instruction: tens of millions of times a second,
// so not in Python.
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace {

// Fields as in instruction_count.py.
struct Count {
    uint64_t done;
    uint64_t limit;
    uint64_t address;
    uint64_t next;
    uint64_t block_end;
    const uint8_t* flash;
    uint64_t flash_base;
    uint64_t flash_bytes;
    int (*read)(void* processor, uint64_t address, void* to, size_t bytes);
    void (*stop)(void* processor);
};

uint16_t halfword_at(const Count& count, void* processor, uint64_t address) {
    uint16_t halfword = 0;
    const uint64_t offset = address - count.flash_base;
    if (offset < count.flash_bytes)
        std::memcpy(&halfword, count.flash + offset, sizeof halfword);
    else
        count.read(processor, address, &halfword, sizeof halfword);
    return halfword;
}

// Unicorn is silent about instructions that their condition switches off; they take a cycle too.
void count_silent_ones(Count& count, void* processor, uint64_t end) {
    while (count.next < end) {
        const bool is_wide = halfword_at(count, processor, count.next) >> 11 >= 0x1D;  // ARMv7-M, A5.1
        count.next += is_wide ? 4 : 2;
        ++count.done;
    }
}

}  // namespace

extern "C" {

void enter_block(void* processor, uint64_t address, uint32_t bytes, void* data) {
    Count& count = *static_cast<Count*>(data);
    count_silent_ones(count, processor, count.block_end);
    count.next = address;
    count.block_end = address + bytes;
}

void before_instruction(void* processor, uint64_t address, uint32_t bytes, void* data) {
    Count& count = *static_cast<Count*>(data);
    count_silent_ones(count, processor, address);
    if (count.done >= count.limit) {
        count.stop(processor);
        return;
    }
    ++count.done;
    count.address = address;
    count.next = address + bytes;
}
}
