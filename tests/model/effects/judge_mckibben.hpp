#pragma once
#include <map>
#include <string>

#include "judge.hpp"

namespace isorig::test {

/// The second writings of quasi_linear_viscoelasticity, directional_damping, mullins_softening, permanent_set,
/// friction_with_load and strain_stiffening/lock.
void add_mckibben(std::map<std::string, Judge>& of);

}  // namespace isorig::test
