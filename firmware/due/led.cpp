#include "led.h"

#include "clock.h"
#include "sam3x.h"

namespace fltea {
namespace due {
namespace led {

namespace {

using namespace sam3x;

constexpr uint32_t kPin = 1u << 27;
constexpr uint32_t kHalfPeriodUs = 1u << 19;

}  // namespace

void start() {
    clock::enable(PIOB_IRQ);
    PIOB_OER::write(kPin);
    PIOB_PER::write(kPin);
}

void show(uint32_t now_us) {
    if (now_us & kHalfPeriodUs) {
        PIOB_SODR::write(kPin);
    } else {
        PIOB_CODR::write(kPin);
    }
}

}  // namespace led
}  // namespace due
}  // namespace fltea
