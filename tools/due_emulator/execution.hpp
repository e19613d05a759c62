// Data that execution.cpp and Python share. Each struct has the fields of the class of the same name in
// execution.py or quick_reads.py, in the same order.
#pragma once
#include <cstddef>
#include <cstdint>

#include "refusals.hpp"

namespace {

enum RegisterKind : uint64_t { kNone, kWord, kCounter };

struct QuickRegister {
    uint64_t address;
    uint64_t kind;
    uint64_t clock;
    uint64_t value;
    uint64_t cleared;
    uint64_t from_ps;
    uint64_t from_cycles;
    uint64_t hz;
    uint64_t divider;
    uint64_t period;
};

struct QuickReads {
    uint64_t clocked;
    uint64_t count;
    QuickRegister registers[16];
};

// Facts about a block of code in flash. They are stored in a table that has one entry for each halfword of
// flash. A block uses the entry of its first halfword.
struct Block {
    uint16_t bytes;
    uint16_t instructions;
    // Bit i is 1 if register i must hold a multiple of 4 when the block begins, because an address is
    // computed from it. If it holds another value, the block runs on the exact processor (the Unicorn
    // instance that checks each instruction).
    uint16_t aligned;
    uint8_t needs_exact;
};

constexpr size_t kPollPcs = 8;
constexpr int kRegisters = 13;  // r0 to r12, in which a loop may count its iterations
constexpr int kNumbers = 16;
constexpr size_t kCodeBytes = 4096;

struct Execution {
    uint64_t done;
    uint64_t limit;
    uint64_t address;
    uint64_t next;
    uint64_t block_end;
    uint64_t slice_ps;
    uint64_t charged_ps;
    uint64_t hz;
    uint64_t until_ps;
    uint64_t longest;
    uint64_t next_event_ps;
    uint64_t halted_until_ps;
    uint64_t waiting;
    uint64_t stops;
    uint64_t dead;
    uint64_t dropped;
    uint64_t interrupt;
    uint64_t refusal;
    uint64_t refused_value;
    uint64_t traps_division;
    uint64_t may_be_fast;
    uint64_t may_be_quick;
    uint64_t calm;
    uint64_t go_fast;
    uint64_t breakpoint;  // on_limit is called before the instruction at this address runs
    uint64_t fast_block;
    uint64_t code_begin;
    uint64_t code_end;
    uint64_t recent_count;
    uint64_t recent_pcs[kPollPcs];
    uint64_t recent_values[kPollPcs];
    uint64_t recent_changes[kPollPcs];
    uint64_t recent_registers[kPollPcs];
    // how often a read of a peripheral gave another value than the same instruction's read before it
    uint64_t changes;
    int32_t registers[kNumbers];
    uint64_t access_cycles;
    uint64_t waiting_instructions;
    uint64_t poll_near_ps;
    uint64_t poll_step_ps;
    uint64_t pc_register;
    uint64_t epsr_register;
    uint64_t flush_control;
    const uint8_t* flash;
    uint64_t flash_base;
    uint64_t flash_bytes;
    const QuickReads* quick;
    Block* blocks;
    void* exact;
    void* fast;
    void* context;
    void* fresh;
    uint64_t (*on_read)(uint64_t now_ps, uint64_t address, uint64_t size);
    void (*on_write)(uint64_t now_ps, uint64_t address, uint64_t size, uint64_t value);
    void (*on_events)(uint64_t now_ps);
    void (*on_limit)(uint64_t now_ps, uint64_t pc);
    int (*mem_read)(void* processor, uint64_t address, void* to, size_t bytes);
    int (*emu_start)(void* processor, uint64_t begin, uint64_t end, uint64_t timeout, size_t count);
    int (*emu_stop)(void* processor);
    int (*reg_read)(void* processor, int id, void* value);
    int (*context_save)(void* processor, void* context);
    int (*context_restore)(void* processor, void* context);
    int (*ctl)(void* processor, uint32_t control, ...);
};

struct Space {
    Execution* execution;
    uint64_t base;
};

}  // namespace
