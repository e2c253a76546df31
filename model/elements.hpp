#pragma once
#include "model/process.hpp"

/// The elements a nominal model is composed of.
namespace isorig::model::element {

const Physics& spring();
const Physics& maxwell();
const Physics& dashpot();
const Physics& mass();
const Physics& constant();
const Physics& gravity();

/// What was measured and has no law yet: tables of one variable, in force or in motion.
const Physics& empirical_force();
const Physics& empirical_motion();

}  // namespace isorig::model::element
