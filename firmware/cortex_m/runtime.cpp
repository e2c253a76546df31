#include "firmware/cortex_m/startup.hpp"

// Called through a virtual table whose object does not exist yet: a defect that is to show, as a reset.
extern "C" [[noreturn]] void __cxa_pure_virtual();
extern "C" void __cxa_pure_virtual() {
  isorig::firmware::cortex_m::reset_system();
}
