#pragma once
#include <map>
#include <string>

#include "judge.hpp"

namespace isorig::test {

/// The second writings of quasi_linear_viscoelasticity, directional_damping, mullins_softening, permanent_set and
/// friction_with_load.
void add_mckibben(std::map<std::string, Judge>& of);

}  // namespace isorig::test
