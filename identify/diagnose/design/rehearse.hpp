#pragma once
#include "identify/diagnose/fit/series.hpp"
#include "protocol/plan.hpp"

namespace isorig::identify {

/// How the recorder will see it.
struct Sampling {
  double full_s = 0.01;      ///< between readings at full rate
  double averaged_s = 0.05;  ///< between means elsewhere
};

/// The recording that a plan of one session will give, but for the force: its motion as a frame of finite
/// bandwidth makes it (corners rounded over 60 ms, kTurn_s at each target), its set-points as pressure, bins
/// as fine as a recording's own would be, with the number of readings that each will hold. Begins when the
/// pressure is there.
[[nodiscard]] Series rehearse(const protocol::Plan& plan, const model::Reference& reference, const Sampling& sampling);

}  // namespace isorig::identify
