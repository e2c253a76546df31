#include "firmware/cortex_m/startup.hpp"

#include "firmware/mps2/machine.hpp"

using namespace isorig::firmware;

extern "C" [[noreturn]] void reset_handler() {
  cortex_m::enable_fpu();
  cortex_m::initialise_memory();
  mps2::exit_emulator(static_cast<uint32_t>(main()));
}

namespace {
[[noreturn]] void fault() {
  mps2::exit_emulator(mps2::kExitFault);
}
}  // namespace

using Vector = void (*)();
struct VectorTable {
  uint32_t* stack;
  Vector handlers[15];
};

extern const VectorTable vectors;
__attribute__((section(".vectors"), used))
const VectorTable vectors = {_stack_top,
                             {reset_handler, fault, fault, fault, fault, fault, nullptr, nullptr, nullptr, nullptr,
                              fault, fault, nullptr, fault, mps2::tick}};
