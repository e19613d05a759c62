// The functions that Unicorn calls at each block of code, before each instruction and at each access to a
// peripheral. They run millions of times a second, so they are not in Python. The code also chooses between
// two Unicorn instances, called processors, that share one memory. The exact processor can stop before any
// instruction, and knows at each access which instruction makes it. The fast processor counts whole blocks of
// code, has no peripherals, and stops before an instruction that it cannot execute exactly. While the program
// makes no access to a peripheral, a slice continues on the fast processor. The results are those that the
// exact processor alone would give.
#include "execution.hpp"

#include <cstring>

namespace {

constexpr uint64_t kPsPerS = 1000000000000;
constexpr uint64_t kNoEnd = 0xFFFFFFFE;
constexpr uint64_t kNowhere = 1;
constexpr uint64_t kThumb = 1;
constexpr uint32_t kEpsrThumb = 1 << 24;
constexpr uint32_t kExceptionExit = 8;
constexpr uint64_t kNoInterrupt = UINT64_MAX;
// After this many instructions without an access to a peripheral, the fast processor takes over. A switch
// takes as long as about 100 instructions.
constexpr uint64_t kCalmInstructions = 100;

// Time

uint64_t time_after(const Execution& e, uint64_t instructions) {
    return e.slice_ps + instructions * kPsPerS / e.hz + e.charged_ps;
}

// Returns the virtual time at which the present instruction began. `done`, the number of instructions that
// were counted in this slice, can still be 0: if Unicorn starts at a conditional instruction, it may not call
// before_instruction, which counts them.
uint64_t time_of_instruction(const Execution& e) {
    if (e.done) return time_after(e, e.done - 1);
    const uint64_t cycle_ps = (kPsPerS + e.hz - 1) / e.hz;
    return e.charged_ps > cycle_ps ? e.slice_ps + e.charged_ps - cycle_ps : e.slice_ps;
}

// Returns after how many instructions the slice ends if no earlier event is added meanwhile.
uint64_t instructions_to_end(const Execution& e) {
    uint64_t longest = e.longest;
    if (e.waiting && e.done + e.waiting_instructions < longest) longest = e.done + e.waiting_instructions;
    const uint64_t end_ps = e.next_event_ps < e.until_ps ? e.next_event_ps : e.until_ps;
    const uint64_t begin_ps = e.slice_ps + e.charged_ps;
    if (end_ps <= begin_ps) return 0;
    using Wide = unsigned __int128;
    const Wide to_end = (static_cast<Wide>(end_ps - begin_ps) * e.hz + (kPsPerS - 1)) / kPsPerS;
    return to_end < longest ? static_cast<uint64_t>(to_end) : longest;
}

// Code

uint16_t flash_halfword(const Execution& e, uint64_t address) {
    uint16_t halfword = 0;
    std::memcpy(&halfword, e.flash + (address - e.flash_base), sizeof halfword);
    return halfword;
}

bool in_flash(const Execution& e, uint64_t address, uint64_t bytes) {
    return address >= e.flash_base && address + bytes <= e.flash_base + e.flash_bytes;
}

// Whether the instruction can end a slice: UDF, SVC, BKPT, or a hint such as WFI, but not NOP.
bool is_special(uint16_t halfword) {
    const uint16_t high = halfword >> 8;
    const bool is_hint = high == 0xBF && !(halfword & 0xF) && halfword != 0xBF00;
    return high == 0xDE || high == 0xDF || high == 0xBE || is_hint;
}

// Counts the instructions up to `end` that Unicorn has not reported: those whose condition is false. They
// take a cycle, too.
inline void count_silent_ones(Execution& e, void* processor, uint64_t end) {
    while (e.next < end) {
        uint16_t halfword = 0;
        if (in_flash(e, e.next, sizeof halfword))
            halfword = flash_halfword(e, e.next);
        else
            e.mem_read(processor, e.next, &halfword, sizeof halfword);
        e.next += is_wide(halfword) ? 4 : 2;
        ++e.done;
    }
}

uint64_t count_instructions(const Execution& e, uint64_t begin, uint64_t end) {
    uint64_t count = 0;
    for (uint64_t at = begin; at < end; ++count) at += is_wide(flash_halfword(e, at)) ? 4 : 2;
    return count;
}

// Returns the second halfword of an instruction, or 0 if the instruction has only one.
uint16_t second_halfword(const Execution& e, uint64_t address, uint16_t first) {
    return is_wide(first) && in_flash(e, address + 2, 2) ? flash_halfword(e, address + 2) : 0;
}

void describe(const Execution& e, uint64_t address, uint32_t bytes, Block& block) {
    AddressNeeds needs(e.flash, e.flash_base, e.flash_bytes);
    block.bytes = static_cast<uint16_t>(bytes);
    block.instructions = static_cast<uint16_t>(count_instructions(e, address, address + bytes));
    for (uint64_t at = address; at < address + bytes;) {
        const uint16_t halfword = flash_halfword(e, at);
        if (is_special(halfword)) block.needs_exact = 1;
        needs.follow(at, halfword, second_halfword(e, at, halfword));
        at += is_wide(halfword) ? 4 : 2;
    }
    block.aligned = needs.aligned();
    if (needs.unknown()) block.needs_exact = 1;
}

// Returns the block of code at an address, or null if the block is not in flash. Code in flash never changes.
inline Block* find_block(const Execution& e, uint64_t address, uint32_t bytes) {
    if (!in_flash(e, address, bytes)) return nullptr;
    Block& block = e.blocks[(address - e.flash_base) / 2];
    if (block.bytes != bytes) describe(e, address, bytes, block);
    return &block;
}

uint32_t register_of(const Execution& e, void* processor, unsigned number) {
    uint32_t value = 0;
    e.reg_read(processor, e.registers[number], &value);
    return value;
}

bool addresses_are_aligned(const Execution& e, void* processor, const Block& block) {
    for (unsigned i = 0, left = block.aligned; left; ++i, left >>= 1)
        if (left & 1 && register_of(e, processor, i) & 3) return false;
    return true;
}

bool fits(const Execution& e, void* processor, const Block* block) {
    return block && !block->needs_exact && e.done + block->instructions <= e.limit &&
           addresses_are_aligned(e, processor, *block);
}

// Returns why a Cortex-M3 refuses the instruction at `address`, which is about to run.
uint64_t refusal_of(Execution& e, void* processor, uint64_t address) {
    uint16_t code[2] = {0, 0};
    if (in_flash(e, address, sizeof code))
        std::memcpy(code, e.flash + (address - e.flash_base), sizeof code);
    else
        e.mem_read(processor, address, code, sizeof code);
    const Need need = need_of(code[0], code[1]);
    if (need.refusal == kNotRefused || need.on == kPc) return kNotRefused;
    if (need.refusal == kNotOfM3) return need.refusal;
    if (need.refusal == kDividesByZero && !e.traps_division) return kNotRefused;
    e.refused_value = register_of(e, processor, need.on);
    const bool refused = need.refusal == kDividesByZero
                             ? !e.refused_value
                             : e.refused_value & (need.refusal == kWordsUnaligned ? 3 : 1);
    return refused ? need.refusal : kNotRefused;
}

// Accesses to peripherals

// Reads a register without a call of Python, if Python keeps the register's value in QuickReads and the read
// has no side effect. Returns false if Python has to perform the read.
bool read_quickly(const Execution& e, uint64_t address, uint64_t size, uint64_t now_ps, uint64_t* value) {
    if (!e.may_be_quick || size != 4 || e.next_event_ps <= now_ps) return false;
    const QuickReads& quick = *e.quick;
    for (uint64_t i = 0; i < quick.count; ++i) {
        const QuickRegister& r = quick.registers[i];
        if (r.address != address) continue;
        if (r.kind == kNone || (r.clock & ~quick.clocked)) return false;
        if (r.kind == kWord) {
            *value = r.value;
            return !(r.value & r.cleared);
        }
        using Wide = unsigned __int128;
        const Wide cycles =
            static_cast<Wide>(now_ps - r.from_ps) * r.hz / (static_cast<Wide>(kPsPerS) * r.divider);
        *value = static_cast<uint64_t>((r.from_cycles + cycles) % r.period);
        return true;
    }
    return false;
}

// Returns a hash of the values in r0 to r12.
uint64_t hash_of_registers(const Execution& e) {
    uint64_t hash = 14695981039346656037u;
    for (int i = 0; i < kRegisters; ++i) {
        uint32_t value = 0;
        e.reg_read(e.exact, e.registers[i], &value);
        hash = (hash ^ value) * 1099511628211u;
    }
    return hash;
}

// Whether the loop that contains read number `i` only waits. If it counted its iterations, a register would
// change in each one, although all reads give the same values. So the loop only waits if no register has
// changed since this instruction last read. It also passes as waiting if another instruction has meanwhile
// read a new value, because the registers may have changed for that reason.
bool only_waits(Execution& e, uint64_t i) {
    if (e.recent_changes[i] != e.changes) return true;
    const uint64_t hash = hash_of_registers(e);
    const bool same = e.recent_registers[i] == hash;
    e.recent_registers[i] = hash;
    return same;
}

// Advances time if a read is a poll (a read by which the program waits); see POLL_PCS in execution.py.
void charge_read(Execution& e, uint64_t value, uint64_t now_ps) {
    uint64_t i = 0;
    while (i < e.recent_count && e.recent_pcs[i] != e.address) ++i;
    if (i < e.recent_count) {
        if (e.recent_values[i] != value) {
            ++e.changes;
        } else if (only_waits(e, i)) {
            const uint64_t to_event_ps = e.next_event_ps > now_ps ? e.next_event_ps - now_ps : 0;
            e.charged_ps += to_event_ps <= e.poll_near_ps ? to_event_ps : e.poll_step_ps;
        }
    } else {
        if (e.recent_count >= kPollPcs) e.recent_count = i = 0;
        ++e.recent_count;
        e.recent_pcs[i] = e.address;
        e.recent_registers[i] = 0;
    }
    e.recent_values[i] = value;
    e.recent_changes[i] = e.changes;
}

// Makes an access to a peripheral at its exact time. Then processes the events that are due after the access;
// they may end the slice.
uint64_t access(Execution& e, uint64_t address, uint64_t size, const uint64_t* written) {
    if (e.dead) return 0;
    e.calm = 0;
    const uint64_t now_ps = time_of_instruction(e);
    const uint64_t next_event_ps = e.next_event_ps;
    uint64_t value = 0;
    if (written) {
        e.on_write(now_ps, address, size, *written);
    } else {
        if (!read_quickly(e, address, size, now_ps, &value)) value = e.on_read(now_ps, address, size);
    }
    if (e.dead) {
        e.limit = 0;
        return 0;
    }
    // If the read has changed the time of the next event, it has started an action, so it is no poll. Time
    // must not jump then, because the code after the read may have little time until that event.
    if (written || e.next_event_ps != next_event_ps)
        e.recent_count = 0;
    else if (!e.dropped)
        charge_read(e, value, now_ps);
    e.charged_ps += e.access_cycles * kPsPerS / e.hz;
    // Events during the access need not end the slice: often the program polls because it waits for them.
    const uint64_t end_ps = time_of_instruction(e);
    // A change of BASEPRI, which Unicorn does not report, may have enabled a waiting interrupt.
    if (e.next_event_ps <= end_ps || e.waiting) e.on_events(end_ps);
    e.limit = e.dead || e.stops || end_ps < e.halted_until_ps ? 0 : instructions_to_end(e);
    return value;
}

// Notes the range of the program's code that is in RAM. Of the two emulated processors, only the exact one,
// which checks each instruction, runs this code. If the fast one overwrites the code, the exact one does not
// notice. Therefore run_fast compares the contents of the range before and after.
void note_code_elsewhere(Execution& e, uint64_t address, uint64_t bytes) {
    if (e.code_begin == e.code_end) e.code_begin = e.code_end = address;
    if (address < e.code_begin) e.code_begin = address;
    if (address + bytes > e.code_end) e.code_end = address + bytes;
    if (e.code_end - e.code_begin > kCodeBytes) e.may_be_fast = 0;
}

// Refuses a jump to an address without bit 0, which takes a processor out of Thumb state. This must be
// checked before the processor starts again, because a start always sets Thumb state.
void check_thumb(Execution& e, void* processor) {
    uint32_t epsr = 0;
    e.reg_read(processor, static_cast<int>(e.epsr_register), &epsr);
    if (!(epsr & kEpsrThumb)) e.refusal = kNotThumb;
}

// Runs blocks with the fast processor, starting from the state of the exact processor, and then copies the
// new state to the exact processor.
void run_fast(Execution& e, uint64_t pc) {
    uint8_t code[kCodeBytes], code_now[kCodeBytes];
    const size_t code_bytes = e.code_end - e.code_begin;
    if (code_bytes) e.mem_read(e.exact, e.code_begin, code, code_bytes);
    e.context_save(e.exact, e.context);
    e.context_restore(e.fast, e.context);
    e.fast_block = kNowhere;
    const int error = e.emu_start(e.fast, pc | kThumb, kNoEnd, 0, 0);
    check_thumb(e, e.fast);
    const bool is_cut_off = error || (e.interrupt != kNoInterrupt && e.interrupt != kExceptionExit);
    if (is_cut_off && e.refusal != kNotThumb && e.fast_block != kNowhere) {
        // Of the two emulated processors, the fast one has stopped at an instruction that it cannot run. The
        // exact one will run this instruction, and report what it does.
        Block& block = e.blocks[(e.fast_block - e.flash_base) / 2];
        uint32_t stopped_at = 0;
        e.reg_read(e.fast, static_cast<int>(e.pc_register), &stopped_at);
        if (stopped_at >= e.fast_block && stopped_at < e.fast_block + block.bytes) {
            e.done -= count_instructions(e, stopped_at, e.fast_block + block.bytes);
            block.needs_exact = 1;
        }
        e.interrupt = kNoInterrupt;
        e.calm = 0;
    }
    e.context_save(e.fast, e.context);
    e.context_restore(e.exact, e.context);
    // A saved context has pointers into the Unicorn instance that it came from. So far the fast processor had
    // a context of the exact one; now it gets its own context back.
    e.context_restore(e.fast, e.fresh);
    if (code_bytes) {
        e.mem_read(e.exact, e.code_begin, code_now, code_bytes);
        if (std::memcmp(code, code_now, code_bytes)) e.ctl(e.exact, static_cast<uint32_t>(e.flush_control));
    }
    e.address = kNowhere;
    e.next = e.block_end = 0;
}

}  // namespace

extern "C" {

void enter_block(void* processor, uint64_t address, uint32_t bytes, void* data) {
    Execution& e = *static_cast<Execution*>(data);
    count_silent_ones(e, processor, e.block_end);
    e.next = address;
    e.block_end = address + bytes;
    if (!e.may_be_fast || e.traps_division) return;
    const Block* block = find_block(e, address, bytes);
    if (!block) {
        note_code_elsewhere(e, address, bytes);
        return;
    }
    e.calm += block->instructions;
    if (e.calm >= kCalmInstructions && fits(e, processor, block)) {
        e.go_fast = 1;
        e.emu_stop(processor);
    }
}

void enter_block_fast(void* processor, uint64_t address, uint32_t bytes, void* data) {
    Execution& e = *static_cast<Execution*>(data);
    const Block* block = find_block(e, address, bytes);
    if (!fits(e, processor, block)) {
        if (e.done + (block ? block->instructions : 0) <= e.limit) e.calm = 0;
        e.emu_stop(processor);
        return;
    }
    e.fast_block = address;
    e.done += block->instructions;
}

void before_instruction(void* processor, uint64_t address, uint32_t bytes, void* data) {
    Execution& e = *static_cast<Execution*>(data);
    if (e.go_fast) return;
    count_silent_ones(e, processor, address);
    if (e.done >= e.limit || (address == e.breakpoint && !e.stops)) {
        if (!e.dead && !e.stops && e.limit) e.on_limit(time_after(e, e.done), address);
        e.limit = e.dead || e.stops || e.slice_ps < e.halted_until_ps ? 0 : instructions_to_end(e);
        if (!e.limit) {
            e.emu_stop(processor);
            return;
        }
    }
    e.refusal = refusal_of(e, processor, address);
    if (e.refusal) {
        e.emu_stop(processor);
        return;
    }
    ++e.done;
    e.address = address;
    e.next = address + bytes;
}

void take_interrupt(void* processor, uint32_t number, void* data) {
    static_cast<Execution*>(data)->interrupt = number;
    static_cast<Execution*>(data)->emu_stop(processor);
}

uint64_t read_peripheral(void*, uint64_t offset, unsigned size, void* data) {
    const Space& space = *static_cast<Space*>(data);
    return access(*space.execution, space.base + offset, size, nullptr);
}

void write_peripheral(void*, uint64_t offset, unsigned size, uint64_t value, void* data) {
    const Space& space = *static_cast<Space*>(data);
    access(*space.execution, space.base + offset, size, &value);
}

// Runs the program from an address until something ends the slice. Returns Unicorn's error, or 0.
int run(Execution* execution, uint64_t pc) {
    Execution& e = *execution;
    const uint64_t to_end = instructions_to_end(e);
    e.limit = to_end ? to_end : 1;
    while (true) {
        e.go_fast = 0;
        const int error = e.emu_start(e.exact, pc | kThumb, kNoEnd, 0, 0);
        check_thumb(e, e.exact);
        if (!e.go_fast || e.refusal) return error;
        uint32_t stopped_at = 0;
        e.reg_read(e.exact, static_cast<int>(e.pc_register), &stopped_at);
        e.go_fast = 0;
        run_fast(e, stopped_at);
        e.reg_read(e.exact, static_cast<int>(e.pc_register), &stopped_at);
        pc = stopped_at;
        if (e.interrupt != kNoInterrupt || e.refusal) return 0;
    }
}
}
