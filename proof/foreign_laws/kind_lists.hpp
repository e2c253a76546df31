#pragma once
#include "proof/foreign_laws/kinds.hpp"

namespace isorig::proof::foreign {

[[nodiscard]] std::vector<Kind> specimen_kinds();  ///< friction, stiffening, softening
[[nodiscard]] std::vector<Kind> flow_kinds();      ///< relaxation, viscosity, pressure, slack
[[nodiscard]] std::vector<Kind> rig_kinds();       ///< sensor, fixture, kinematics
[[nodiscard]] std::vector<Kind> unknown_kinds();

}  // namespace isorig::proof::foreign
