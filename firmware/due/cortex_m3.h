// The features of the processor that the code for the Due uses. "ARMv7-M manual" stands for the ARMv7-M
// Architecture Reference Manual.
#pragma once

#include "register.h"

namespace cortex_m3 {

// Register that enables the interrupts 0 to 31 (ARMv7-M manual, B3.4.4).
using NVIC_ISER0 = sam3x::ReadWrite<0xE000E100>;
// Register with the address of the vector table (ARMv7-M manual, B3.2.5).
using SCB_VTOR = sam3x::ReadWrite<0xE000ED08>;

inline void enable_irq(uint32_t irq) { NVIC_ISER0::write(1u << irq); }

// Waits until all earlier memory writes are completed, before any later instruction runs (ARMv7-M manual,
// A3.7.3).
inline void memory_barrier() { asm volatile("dsb" ::: "memory"); }

// Sleeps until an interrupt is pending. This works also while interrupts are disabled (ARMv7-M Architecture
// Reference Manual, B1.5.19).
inline void wait_for_interrupt() { asm volatile("dsb\n\twfi" ::: "memory"); }

// Disables interrupts as long as the object exists. Such objects may be nested.
class InterruptLock {
  public:
    InterruptLock() { asm volatile("mrs %0, primask\n\tcpsid i" : "=r"(primask_)::"memory"); }
    ~InterruptLock() { asm volatile("msr primask, %0" ::"r"(primask_) : "memory"); }
    InterruptLock(const InterruptLock&) = delete;
    InterruptLock& operator=(const InterruptLock&) = delete;

  private:
    uint32_t primask_ = 0;
};

}  // namespace cortex_m3
