// Instructions that a Cortex-M3 refuses and Unicorn does not (ARMv7-M Architecture Reference Manual, here
// "ARMv7-M"; its chapter A5 has the encodings). The emulator has two Unicorn instances. For the exact one,
// each instruction is checked (`need_of`). For the fast one, `AddressNeeds` examines each block of code once.
// It finds which registers have to hold multiples of 4 at the beginning of the block, or it finds that this
// cannot be decided.
#pragma once
#include <cstdint>
#include <cstring>

namespace {

enum Refusal : uint64_t {
    kNotRefused,
    kWordsUnaligned,
    kHalfwordUnaligned,
    kNotOfM3,
    kDividesByZero,
    kNotThumb,
};

constexpr unsigned kSp = 13;
constexpr unsigned kPc = 15;

// A reason why an instruction may be refused, and the register whose value decides whether it is refused.
struct Need {
    Refusal refusal;
    unsigned on;  // number of the register
};

inline bool is_wide(uint16_t halfword) { return halfword >> 11 >= 0x1D; }  // A5.1

// Examines an instruction of 16 bits. Of these instructions, LDM, STM, PUSH and POP need aligned addresses.
inline Need need_of_narrow(uint16_t h) {
    if (h >> 12 == 0xC) return {kWordsUnaligned, h >> 8 & 7u};
    if ((h & 0xF600) == 0xB400) return {kWordsUnaligned, kSp};
    if ((h & 0xFFF7) == 0xB650) return {kNotOfM3, 0};  // SETEND
    return {kNotRefused, 0};
}

// Examines loads and stores of several words, and exclusive loads and stores (ARMv7-M, A5.3.5, A5.3.6;
// alignment: A3.2.1).
inline Need need_of_several(uint16_t h1, uint16_t h2) {
    const unsigned base = h1 & 15u;
    const bool several = !(h1 & 0x40);
    const bool exclusive = !several && !(h1 & 0x0120);
    if (!exclusive || !(h1 & 0x80)) return {kWordsUnaligned, base};
    switch (h2 >> 4 & 15) {
        case 5:
            return {kHalfwordUnaligned, base};  // LDREXH, STREXH
        case 7:
            return {kNotOfM3, 0};  // LDREXD, STREXD
        default:
            // exclusive accesses to bytes, and table branches: they need no alignment
            return {kNotRefused, 0};
    }
}

// Returns why an instruction may be refused, and on which register's value this depends. `h1`, `h2`: the
// instruction's two halfwords; `h2` has no meaning if the instruction has only one.
inline Need need_of(uint16_t h1, uint16_t h2) {
    if (!is_wide(h1)) return need_of_narrow(h1);
    if (h1 >> 9 == 0x74) return need_of_several(h1, h2);
    const unsigned high = h1 >> 4;
    // The Cortex-M3 lacks the instructions of the DSP extension: SXTAH, UXTAB and their like, which extend a
    // byte or halfword and add; SSAT16 and USAT16; and multiplications of halfwords, of several values at
    // once, or with only the upper half of the product as the result.
    if (high >= 0xFA0 && high <= 0xFA5 && (h2 & 0xF080) == 0xF080 && (h1 & 15) != kPc) return {kNotOfM3, 0};
    if ((high == 0xF32 || high == 0xF3A) && !(h2 & 0xF0C0)) return {kNotOfM3, 0};
    if (high > 0xFB0 && high < 0xFB8) return {kNotOfM3, 0};
    if (high > 0xFBB && high < 0xFBF && h2 & 0xF0) return {kNotOfM3, 0};
    if ((high == 0xFB9 || high == 0xFBB) && (h2 & 0xF0F0) == 0xF0F0) return {kDividesByZero, h2 & 15u};
    return {kNotRefused, 0};
}

// Tracks the registers through a block of code. Of each register, one of three things is known. Its value is
// a multiple of 4; or it is the value that a certain register had at the beginning of the block, plus or
// minus a multiple of 4; or nothing is known.
class AddressNeeds {
  public:
    AddressNeeds(const uint8_t* flash, uint64_t base, uint64_t bytes)
        : flash_{flash}, base_{base}, bytes_{bytes} {
        for (unsigned i = 0; i < 16; ++i) from_[i] = i;
    }

    // Notes how the next instruction of the block changes what is known of the registers.
    void follow(uint64_t address, uint16_t h1, uint16_t h2) {
        const Need need = need_of(h1, h2);
        if (need.refusal == kNotOfM3) unknown_ = true;
        if (need.refusal == kWordsUnaligned || need.refusal == kHalfwordUnaligned) require(from_[need.on]);
        is_conditional_ = conditionals_ > 0;
        if (is_conditional_) --conditionals_;
        if (is_wide(h1))
            follow_wide(address, h1, h2);
        else
            follow_narrow(address, h1);
    }

    // Bit i is 1 if register i must hold a multiple of 4 at the beginning of the block.
    uint16_t aligned() const { return aligned_; }
    // Whether the registers' values at the block's beginning do not suffice to say if all its instructions
    // will be accepted. This is so if an address may come from something else than these values, or if the
    // block has an instruction that a Cortex-M3 does not know.
    bool unknown() const { return unknown_; }

  private:
    // `from_[i]` says where the value of register i comes from. It is the number of a register: the value is
    // what that register had at the block's beginning, plus or minus a multiple of 4. Or it is one of two
    // constants. kMultiple: the value is a multiple of 4. (It is the number of PC, because PC as a base
    // address is always a multiple of 4.) kElsewhere: nothing is known of the value.
    static constexpr unsigned kMultiple = kPc;
    static constexpr unsigned kElsewhere = 16;

    void require(unsigned origin) {
        if (origin == kElsewhere)
            unknown_ = true;
        else if (origin != kMultiple)
            aligned_ = static_cast<uint16_t>(aligned_ | 1u << origin);
    }

    void set(unsigned to, unsigned origin) {
        if (to != kPc) from_[to] = is_conditional_ && origin != from_[to] ? kElsewhere : origin;
    }

    void lose(unsigned to) { set(to, kElsewhere); }

    void lose_all(uint16_t list) {
        for (unsigned i = 0; i < kPc; ++i)
            if (list >> i & 1) lose(i);
    }

    // Register `to` becomes register `other` plus or minus a number of bytes.
    void add(unsigned to, unsigned other, uint32_t bytes) { set(to, bytes & 3 ? kElsewhere : from_[other]); }

    void become(unsigned to, uint32_t value) { set(to, value & 3 ? kElsewhere : kMultiple); }

    void load_literal(unsigned to, uint64_t at) {
        uint32_t value = 1;
        if (at >= base_ && at + sizeof value <= base_ + bytes_)
            std::memcpy(&value, flash_ + (at - base_), sizeof value);
        become(to, value);
    }

    // Notes what an instruction of 16 bits does to the registers: moves, shifts, additions, comparisons,
    // loads and stores (ARMv7-M, A5.2).
    void follow_narrow(uint64_t address, uint16_t h) {
        const unsigned low = h & 7u, middle = h >> 3 & 7u, high = h >> 8 & 7u, wide = (h >> 4 & 8u) | low;
        const unsigned first = h >> 11;
        if (first == 0) {
            const unsigned shift = h >> 6 & 31u;
            shift >= 2 ? set(low, kMultiple) : shift ? lose(low) : set(low, from_[middle]);
        } else if (h >> 10 == 7) {
            add(low, middle, h >> 6 & 7u);
        } else if (first < 4) {
            lose(low);
        } else if (first == 4) {
            become(high, h & 0xFFu);
        } else if (first == 6 || first == 7) {
            add(high, high, h & 0xFFu);
        } else if (h >> 8 == 0x46) {
            set(wide, from_[h >> 3 & 15u]);
        } else if (h >> 8 == 0x44) {
            lose(wide);
        } else if (h >> 10 == 16) {
            const unsigned what = h >> 6 & 15u;
            if (what != 8 && what != 10 && what != 11) lose(low);
        } else if (first == 9) {
            load_literal(high, ((address + 4) & ~3ull) + 4u * (h & 0xFFu));
        } else if (first == 19) {
            lose(high);
        } else if ((h >> 12 == 5 && (h >> 9 & 7) > 2) || (first >= 12 && first < 18 && (first & 1))) {
            lose(low);
        } else if (first == 20) {
            set(high, kMultiple);
        } else if (first == 21) {
            set(high, from_[kSp]);
        } else if (h >> 8 == 0xB2 || h >> 8 == 0xBA) {
            lose(low);
        } else if (h >> 9 == 0x5E || first == 25) {
            lose_all(h & 0xFF);
        } else if (h >> 8 == 0xBF && h & 15) {
            conditionals_ = h & 1 ? 4 : h & 2 ? 3 : h & 4 ? 2 : 1;
        }
    }

    void follow_wide(uint64_t address, uint16_t h1, uint16_t h2) {
        const unsigned base = h1 & 15u, to = h2 >> 8 & 15u, other = h2 >> 12;
        switch (h1 >> 9) {
            case 0x74:
                follow_several(h1, h2);
                break;
            case 0x75:
                follow_shifted(h1, h2);
                break;
            case 0x7C:
                follow_one_word(address, h1, h2);
                break;
            case 0x7D:
                lose(to);
                if ((h1 & 0x180) == 0x180) lose(other);
                break;
            case 0x78:
            case 0x79:
            case 0x7A:
            case 0x7B:
                if (h2 >> 15) {
                    lose(to);
                    if (h1 >> 5 == 0x79C) lose(kSp);  // the instruction MSR may set SP
                } else
                    follow_immediate(h1, h2, base, to);
                break;
            default:
                unknown_ = true;
        }
    }

    // Notes which registers a load or store of several words changes. If it changes the base register, it
    // does so by a multiple of 4, so what is known of the base register stays true.
    void follow_several(uint16_t h1, uint16_t h2) {
        const bool loads = h1 & 0x10;
        if (!(h1 & 0x40)) {
            if (loads) lose_all(h2);
            return;
        }
        const bool exclusive = !(h1 & 0x0120);
        if (loads || exclusive) {
            lose(h2 >> 12);
            lose(h2 >> 8 & 15u);
        }
        if (exclusive) lose(h2 & 15u);
    }

    // Notes what is known of the result of an instruction that shifts a register by a constant (ARMv7-M,
    // A5.3.11). The result can be a copy of the register, a multiple of 4, or another register plus a
    // multiple of 4, such as the address of an entry in a table.
    void follow_shifted(uint16_t h1, uint16_t h2) {
        const unsigned to = h2 >> 8 & 15u, base = h1 & 15u;
        const unsigned shift = (h2 >> 10 & 0x1Cu) | (h2 >> 6 & 3u);
        const bool to_left = !(h2 & 0x30);
        const unsigned what = h1 >> 5 & 15u;
        if (what == 2 && base == kPc && to_left && shift != 1)
            set(to, shift ? kMultiple : from_[h2 & 15u]);
        else if (what == 8 && to_left && shift >= 2)
            set(to, from_[base]);
        else
            lose(to);
    }

    void follow_one_word(uint64_t address, uint16_t h1, uint16_t h2) {
        const unsigned base = h1 & 15u, to = h2 >> 12;
        const bool loads = h1 & 0x10;
        if (base == kPc && (h1 & 0x60) == 0x40 && loads) {
            const uint64_t here = (address + 4) & ~3ull, far = h2 & 0xFFFu;
            load_literal(to, h1 & 0x80 ? here + far : here - far);
            return;
        }
        if (!(h1 & 0x80) && (h2 & 0x0900) == 0x0900) add(base, base, h2 & 0xFFu);
        if (loads) lose(to);
    }

    // Notes what is known of the result of ADD, SUB, MOV or a similar instruction with a constant (ARMv7-M,
    // A5.3.1, A5.3.3).
    void follow_immediate(uint16_t h1, uint16_t h2, unsigned base, unsigned to) {
        const bool plain = h1 & 0x200;
        const unsigned what = h1 >> 4 & 31u;
        const uint32_t number = plain ? h2 & 0xFFu : expanded(h1, h2);
        if (!plain && (what >> 1 == 8 || what >> 1 == 13))
            add(to, base, number);
        else if (!plain && what >> 1 == 2 && base == kPc)
            become(to, number);
        else if (plain && (what == 0 || what == 10))
            add(to, base, number);
        else if (plain && what == 4)
            become(to, number);
        else if (!(plain && what == 12))  // MOVT leaves the lower half of the register unchanged.
            lose(to);
    }

    // Computes the constant of an instruction (ARMv7-M, A5.3.2, ThumbExpandImm), as far as is needed to see
    // whether it is a multiple of 4.
    static uint32_t expanded(uint16_t h1, uint16_t h2) {
        const unsigned how = (h1 >> 7 & 8u) | (h2 >> 12 & 7u), byte = h2 & 0xFFu;
        if (how == 2) return byte << 8;
        if (how < 4) return byte;
        const unsigned turn = how << 1 | byte >> 7;
        const uint32_t value = 0x80 | (byte & 0x7F);
        return value >> turn | value << (32 - turn);
    }

    const uint8_t* flash_;
    uint64_t base_, bytes_;
    unsigned from_[16];
    unsigned conditionals_ = 0;
    bool is_conditional_ = false;
    uint16_t aligned_ = 0;
    bool unknown_ = false;
};

}  // namespace
