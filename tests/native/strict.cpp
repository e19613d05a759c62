// This file is only compiled, with the device's flags, and never run. It shows that every template of the
// engine compiles for every number type without exceptions and RTTI.
#include "memory_compressed.hpp"
#include "memory_direct.hpp"
#include "pack_math.hpp"

namespace fltea {
namespace engine {
inline namespace FLTEA_INSTRUCTION_SET {

#define FLTEA_USE(Number)                                                                          \
    template class DirectMemory<Number>;                                                           \
    template class CompressedMemory<Number>;                                                       \
    template void DirectMemory<Number>::state_sums<3>(const Number(&)[3], Number(&)[3]) const;     \
    template void DirectMemory<Number>::state_sums<1>(const Number(&)[1], Number(&)[1]) const;     \
    template void CompressedMemory<Number>::state_sums<3>(const Number(&)[3], Number(&)[3]) const; \
    template void CompressedMemory<Number>::state_sums<1>(const Number(&)[1], Number(&)[1]) const; \
    template Number exp<Number>(Number);                                                           \
    template Number sin_pi<Number>(Number);                                                        \
    template MaskOf<Number> is_finite<Number>(Number)

typedef Pack<double, kWidth> Wide;
FLTEA_USE(float);
FLTEA_USE(double);
FLTEA_USE(Wide);

}  // namespace FLTEA_INSTRUCTION_SET
}  // namespace engine
}  // namespace fltea
