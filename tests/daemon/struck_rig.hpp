#pragma once
#include <cstdint>

#include "daemon/rig/virtual_rig.hpp"

namespace isorig::daemon::test {

/// What a fault of the catalogue (fault_matrix_faults.cpp) is switched on and off in: the simulated rig, and what of
/// the machine round it whoever ticks it carries out.
class StruckRig {
 public:
  virtual ~StruckRig() = default;
  [[nodiscard]] virtual VirtualRig& rig() noexcept = 0;
  [[nodiscard]] sim::Rig& plant() noexcept { return rig().rig(); }

  bool disk_full = false;    ///< less free than is kept free
  bool disk_hangs = false;   ///< the recorder's thread does not come back
  std::int64_t late_ns = 0;  ///< of the next tick
};

}  // namespace isorig::daemon::test
