#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include "../daemon/fault_matrix_expect.hpp"
#include "protocol/plan.hpp"

/// What strikes a run of the soak, and when: drawn from the fault matrix' catalogue by a seed.
namespace isorig::soak {

struct Strike {
  std::uint32_t step = 0;             ///< of the plan
  double after_s = 0.0;               ///< the step began
  std::size_t fault = 0;              ///< index into daemon::test::faults()
  std::optional<std::size_t> second;  ///< strikes while the first is still there
  double second_after_s = 0.0;
  double watch_s = 0.0;  ///< so long the fault stays when nothing trips
  double stay_s = 0.0;   ///< and so long after a trip, before somebody repairs it
};

/// In the order of their steps. Every kind of step has the same chance, whatever share of the time it takes: the
/// strokes that matter are seconds of an hour.
[[nodiscard]] std::vector<Strike> draw(const protocol::Plan& plan, std::uint64_t seed, int count);

/// Which row of the fault matrix a step is.
[[nodiscard]] daemon::test::At situation_of(const protocol::Plan& plan, std::uint32_t step);

}  // namespace isorig::soak
