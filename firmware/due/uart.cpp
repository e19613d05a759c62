#include "uart.h"

#include "../core/messages.h"
#include "../core/settings.h"
#include "clock.h"
#include "cortex_m3.h"
#include "handlers.h"
#include "sam3x.h"

namespace fltea {
namespace due {

namespace {

using namespace sam3x;

// The divisor is computed as in the SAM3X datasheet, UART, Baud Rate Generator.
constexpr uint32_t kBaudTimes16 = settings::kLineBaud * 16;
constexpr uint32_t kDivisor = (clock::kMasterHz + kBaudTimes16 / 2) / kBaudTimes16;
// The baud rate is right within 1 %. If that of the host is, too, the two differ by at most 2 %, and a byte
// of ten bits still arrives correctly.
static_assert(kDivisor * kBaudTimes16 >= clock::kMasterHz / 100 * 99 &&
                  kDivisor * kBaudTimes16 <= clock::kMasterHz / 100 * 101,
              "the baud rate is right within 1 %");

constexpr uint32_t kTransmitPin = 1u << 9;  // pin PA9, whose peripheral A is UTXD

// Size of the ring buffer: it has room for two of the longest frames, and is a power of two, so that the
// counters below may wrap.
constexpr uint32_t kRingBytes = 512;
static_assert(kRingBytes >= 2 * kMaxWire && (kRingBytes & (kRingBytes - 1)) == 0, "size of the ring");

uint8_t ring[kRingBytes];
uint32_t written;        // number of bytes that the main loop has put into the ring
volatile uint32_t sent;  // number of bytes that the interrupt handler has taken out of the ring
uint32_t in_flight;      // number of bytes that the DMA controller (PDC) is sending

// Passes the next contiguous piece of the ring buffer to the DMA controller (PDC), if there is one. Call this
// with interrupts disabled, and only when the DMA controller is not sending.
void send_next_piece() {
    const uint32_t begin = sent % kRingBytes;
    const uint32_t waiting = written - sent;
    const uint32_t to_end = kRingBytes - begin;
    in_flight = waiting < to_end ? waiting : to_end;
    if (in_flight == 0) {
        // The flag ENDTX stays set while the DMA controller is idle, so its interrupt has to be disabled.
        UART_IDR::write(UART_IDR::ENDTX);
        return;
    }
    cortex_m3::memory_barrier();
    UART_TPR::write(static_cast<uint32_t>(reinterpret_cast<uintptr_t>(&ring[begin])));
    UART_TCR::write(in_flight);
    UART_IER::write(UART_IER::ENDTX);
}

}  // namespace

void Uart::start() {
    clock::enable(UART_IRQ);
    clock::enable(PIOA_IRQ);
    PIOA_ABSR::write(PIOA_ABSR::read() & ~kTransmitPin);
    PIOA_PDR::write(kTransmitPin);
    UART_CR::write(UART_CR::RSTTX | UART_CR::RSTRX | UART_CR::RXDIS);
    UART_MR::write(UART_MR::PAR_NO);
    UART_BRGR::write(kDivisor);
    UART_PTCR::write(UART_PTCR::TXTEN);
    UART_CR::write(UART_CR::TXEN);
    cortex_m3::enable_irq(UART_IRQ);
}

// Bytes that the DMA controller has already sent count as free, even before it has sent the whole piece of
// the ring that it was given. The class Link (core/link.h) relies on this: it expects the room to grow byte
// by byte.
size_t Uart::room() {
    cortex_m3::InterruptLock lock;
    return kRingBytes - (written - sent) + (in_flight - UART_TCR::read());
}

void Uart::write(const uint8_t* data, size_t n) {
    for (size_t i = 0; i < n; ++i) ring[(written + i) % kRingBytes] = data[i];
    cortex_m3::InterruptLock lock;
    written += n;
    if (in_flight == 0) send_next_piece();
}

void on_uart() {
    if (UART_TCR::read() != 0) return;
    sent = sent + in_flight;
    send_next_piece();
}

}  // namespace due
}  // namespace fltea
