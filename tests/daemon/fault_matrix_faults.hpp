#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "daemon/core/core.hpp"
#include "struck_rig.hpp"

namespace isorig::daemon::test {

/// A fault as it is switched on and off in the simulated rig.
struct Fault {
  const char* group;  ///< as the page heads its part of the table
  const char* name;   ///< a test's name, too
  const char* words;
  void (*set)(StruckRig& rig, bool on);
  double lasts_s = 0.0;                    ///< then it is over; 0: until it is repaired
  std::optional<Request::Verb> then = {};  ///< what brings it to light, 20 ms later
  bool of_segment = false;                 ///< a jog, an approach: it strikes just before that is commanded
};

[[nodiscard]] std::span<const Fault> faults();

}  // namespace isorig::daemon::test
