#pragma once
#include "model/process.hpp"

/// One function per file of this folder. Add yours here, in model/catalogue.cpp and in model/CMakeLists.txt
/// (docs/effects.md).
namespace isorig::model::effect {

const Physics& coulomb_friction();
const Physics& strain_stiffening();
const Physics& second_relaxation();
const Physics& nonlinear_viscosity();
const Physics& pressure_coupling();
const Physics& cyclic_softening();
const Physics& force_lag();
const Physics& force_delay();
const Physics& fixture_inertia();
const Physics& zero_drift();
const Physics& grip_slip();
const Physics& crosshead_backlash();
const Physics& slack();
const Physics& viscous_drag();
const Physics& friction_asymmetry();
const Physics& friction_with_pressure();
const Physics& pressure_threshold();
const Physics& cell_nonlinearity();
const Physics& unsettled_start();
const Physics& quasi_linear_viscoelasticity();
const Physics& directional_damping();
const Physics& mullins_softening();
const Physics& permanent_set();
const Physics& friction_with_load();

}  // namespace isorig::model::effect
