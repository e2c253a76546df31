#include <algorithm>
#include <iterator>
#include <ostream>

#include "judge.hpp"

namespace isorig::test {

namespace {

/// Products of a state and a factor: those that know nothing of the past have no error at any step.
std::vector<Case> products() {
  std::vector<Case> out;
  for (const model::Law& law : model::find_physics("discovered")->laws) {
    const auto has = [&](std::string_view word) { return law.name.find(word) != std::string_view::npos; };
    std::vector<std::vector<double>> numbers{{}};
    if (has("arm_")) numbers = {{0.8}, {0.02}, {300.0}};
    if (has("friction_")) numbers = {{0.02}, {0.3}};
    const bool remembers = !numbers.front().empty() || has("_travel") || has("_farthest");
    out.push_back({"discovered", law.name, numbers, {0.4}, remembers ? 1e-6 : 1e-12, remembers ? 2.0 : 0.0});
  }
  return out;
}

}  // namespace

const std::vector<Case>& cases() {
  // A table of one direction jumps at a reversal and is wrong for one instant: the rms goes with the root of
  // the step. Memoryless laws have no error at any step; friction, play and softening know nothing of time.
  static const std::vector<Case> named{
      {"spring", "linear", {{}}, {2.5}, 1e-12, 0, true},
      {"maxwell", "linear", {{0.8}, {0.02}, {300.0}}, {2.0}, 1e-6, 2, false, true},
      {"arm_start", "relaxing", {{2.0, 1.0, 0.0, 0.0}, {20.0, 1.0, 0.0, 0.7}}, {0.5}, 1e-12, 0},
      {"dashpot", "linear", {{}}, {0.4}, 1e-12, 0, false, true},
      {"mass", "linear", {{}}, {3.0}, 1e-12, 0},
      {"constant", "linear", {{}}, {-0.7}, 1e-12, 0, true},
      {"force_zero", "recording", {{0.0}}, {0.3}, 1e-12, 0, true},
      {"gravity", "pendulum", {{1.5}, {400.0}}, {6.0}, 1e-12, 0, true},
      {"empirical_force", "position", {{}}, {1.3}, 1e-9, 0, true},
      {"empirical_force", "rate", {{}}, {1.3}, 1e-9, 0},
      {"empirical_force", "travel", {{}}, {1.3}, 1e-9, 2, true},
      {"empirical_force", "pressure", {{}}, {1.3}, 1e-9, 0},
      {"empirical_force", "time", {{}}, {1.3}, 1e-9, 0},
      {"empirical_force", "extending", {{}}, {1.3}, 1e-9, 0.5, true},
      {"empirical_force", "shortening", {{}}, {1.3}, 1e-9, 0.5, true},
      // A relay jumps within a step.
      {"empirical_memory", "branch", {{0.6, -0.2}}, {0.5}, 1e-9, 0.5, true},
      {"empirical_memory", "structure", {{0.8, 5.0, 0.7}, {0.1, 40.0, 3.0}}, {-0.8, -0.2}, 1e-6, 2},
      {"empirical_memory", "wave", {{7.0}}, {0.3, -0.2, 0.05, 0.1}, 1e-9, 0},
      {"empirical_response", "second_order", {{0.1, 0.05}, {0.4, 0.7}}, {}, 1e-6, 2},
      // The table bends within a stroke, and the arm behind it sees chords.
      {"empirical_motion", "position", {{}}, {}, 2e-2, 2},

      {"coulomb_friction", "dahl", {{0.02}, {0.3}}, {0.8}, 1e-6, 2, true, true},
      {"coulomb_friction", "jenkins", {{0.02}, {0.3}}, {0.8}, 1e-9, 2, true, true},
      {"coulomb_friction", "iwan", {{0.02}, {0.3}}, {0.8}, 1e-9, 2, true, true},
      {"coulomb_friction", "stribeck", {{0.02, 2.0, 0.4}, {0.3, 0.5, 1.5}}, {0.8}, 1e-6, 2, false, true},
      {"coulomb_friction", "stribeck_exponential", {{0.02, 2.0, 0.4}, {0.3, 0.5, 1.5}}, {0.8}, 1e-6, 2, false, true},
      {"coulomb_friction", "iwan_stribeck", {{0.02, 2.0, 0.4}, {0.3, 0.5, 1.5}}, {0.8}, 1e-9, 2},
      // Their own file claims 1e-5 of the sliding force, the error of a table, at any step.
      {"coulomb_friction", "bouc_wen_equal", {{0.02, 1.5}, {0.3, 4.0}}, {0.8}, 1e-5, 2, true, true},
      {"coulomb_friction",
       "bouc_wen",
       {{0.02, 1.2, 0.7}, {0.3, 2.0, 1.0}, {0.1, 10.0, 2.0}},
       {0.8},
       1e-5,
       2,
       true,
       true},
      {"coulomb_friction", "regularised", {{0.002}, {0.5}}, {0.8}, 1e-9, 0, false, true},
      {"strain_stiffening", "quadratic", {{}}, {0.06}, 1e-12, 0, true},
      {"strain_stiffening", "cubic", {{}}, {-0.02}, 1e-12, 0, true},
      {"strain_stiffening", "polynomial", {{}}, {0.06, 0.01}, 1e-12, 0, true},
      {"strain_stiffening", "quintic", {{}}, {0.06, 0.01, -0.004, 0.001}, 1e-12, 0, true},
      {"strain_stiffening", "exponential", {{0.6}, {50.0}}, {0.3}, 1e-12, 0, true},
      {"strain_stiffening", "knee", {{0.4}, {-3.0}}, {0.9}, 1e-12, 0, true},
      {"strain_stiffening", "smooth_knee", {{0.4, 0.2}, {-1.0, 3.0}}, {0.9}, 1e-9, 0, true},
      {"strain_stiffening", "lock", {{3.0}, {40.0}}, {0.3}, 1e-12, 0, true},
      {"second_relaxation", "arm", {{0.1}, {20.0}}, {0.6}, 1e-6, 2, false, true},
      {"second_relaxation", "two_arms", {{0.2, 30.0}}, {0.6, 0.4}, 1e-6, 2, false, true},
      {"second_relaxation", "spectrum", {{0.1, 3.0}, {0.5, 1.0}}, {0.9}, 1e-6, 2, false, true},
      // Its own file claims 1e-4 of the peak at any step.
      {"nonlinear_viscosity", "power_arm", {{0.8, 1.8}, {0.5, 0.7}, {3.0, 3.0}}, {2.0}, 1e-4, 2, false, true},
      {"nonlinear_viscosity", "yield_arm", {{0.8, 0.1}, {0.5, 0.4}, {3.0, 0.01}}, {2.0}, 1e-6, 2, false, true},
      {"nonlinear_viscosity", "power_dashpot", {{0.3}, {2.0}}, {0.4}, 1e-12, 0, false, true},
      {"pressure_coupling", "stiffness", {{}}, {0.15}, 1e-12, 0},
      {"pressure_coupling", "force", {{}}, {0.5}, 1e-12, 0},
      {"pressure_coupling", "both", {{}}, {0.5, -0.1}, 1e-12, 0},
      // Straight between instants is the law's claim; the tracks' pressure is a sine: 0.1^2 / 8 of its curvature, 0.77
      // psi/s^2.
      {"pressure_coupling", "tube", {{0.05}, {2.0}}, {0.5}, 5e-3, 2},
      {"cyclic_softening", "elastic", {{8.0}, {60.0}}, {-0.3}, 1e-9, 2, true},
      {"cyclic_softening", "tangent", {{8.0}, {60.0}}, {-0.3}, 1e-9, 2, true},
      {"cyclic_softening", "overall", {{8.0, 0.2}, {60.0, 0.5}}, {}, 1e-6, 2},
      {"force_lag", "first_order", {{0.005}, {0.3}}, {}, 1e-6, 2},
      {"force_lag", "two_poles", {{0.005}, {0.3}}, {}, 1e-6, 2},
      {"force_delay", "dead_time", {{0.02}, {0.35}, {1.0}}, {}, 1e-9, 2},
      {"fixture_inertia", "rigid", {{}}, {0.5}, 1e-12, 0},
      {"fixture_inertia", "sprung", {{0.03, 0.4}, {0.2, 0.1}, {0.1, 1.0}}, {0.5}, 1.0, 2, false, false, false},
      {"zero_drift", "linear", {{}}, {1.5}, 1e-12, 0},
      {"zero_drift", "settling", {{600.0}}, {0.4}, 1e-9, 0},
      {"zero_drift", "wander", {{9.0}}, {0.1, -0.2, 0.05, 0.3, 0.0, 0.07}, 1e-12, 0},
      {"grip_slip", "event", {{4.0, 0.2, 0.0}}, {}, 2e-2, 1},
      {"grip_slip", "creep", {{4.0, 0.2, 3.0, 0.0}, {2.0, 0.4, 0.5, 0.0}}, {}, 2e-2, 2},
      {"crosshead_backlash", "play", {{0.08, 0.0}, {0.6, 1.0}, {0.3, -1.0}, {0.04, 0.35}}, {}, 2e-2, 2},
      // Behind it the motion is curved within a step, which the arm of the model sees as a chord, as behind a play.
      {"crosshead_backlash",
       "compliant",
       {{0.08, 0.02, 0.0}, {0.6, 0.1, 1.0}, {0.3, 0.005, -1.0}, {0.0, 0.05, 0.0}},
       {},
       2e-2,
       2},
      {"slack", "unilateral", {{}}, {}, 1e-6, 2},
      {"viscous_drag", "linear", {{}}, {0.03}, 1e-12, 0, false, true},
      {"friction_asymmetry", "viscous", {{}}, {0.05}, 1e-12, 0},
      {"friction_asymmetry", "sliding", {{0.02}, {0.3}}, {-0.3}, 1e-6, 2, true},
      {"friction_asymmetry", "both", {{0.05}}, {0.3, 0.05}, 1e-6, 2},
      {"friction_with_pressure", "dahl", {{0.02}, {0.3}}, {0.05}, 1e-6, 2, false, true},
      {"pressure_threshold", "dead_zone", {{15.1}, {3.0}}, {0.7}, 1e-12, 0},
      {"cell_nonlinearity", "quadratic", {{2.0}, {-15.0}}, {}, 1e-6, 2},
      {"cell_nonlinearity", "ceiling", {{4.0, 8.0}, {2.5, 2.0}}, {}, 1e-6, 2},
      {"unsettled_start", "exponential", {{1.0}, {20.0}}, {0.5}, 1e-12, 0},
      {"quasi_linear_viscoelasticity", "fung_arm", {{0.8, 0.3}, {0.02, -0.5}, {300.0, 0.0}}, {2.0}, 1e-6, 2},
      // A parabola over each part of a stroke: its own file claims 4e-7 of z, and no exactness.
      {"quasi_linear_viscoelasticity", "relaxation_time", {{0.8, 0.3}, {0.02, -0.5}, {300.0, 0.9}}, {2.0}, 2e-6, 2},
      {"directional_damping", "series", {{0.8, 0.4}, {0.05, 5.0}, {300.0, 1.0}}, {2.0}, 1e-6, 2, false, true},
      {"directional_damping", "parallel", {{}}, {0.05, 0.02}, 1e-12, 0, false, true},
      {"mullins_softening", "ogden_roxburgh", {{0.7}, {3.0}}, {-0.3}, 1e-6, 2, true},
      {"mullins_softening", "damage", {{0.4}, {5.0}}, {-0.3}, 1e-9, 2, true},
      {"permanent_set", "proportional", {{}}, {-0.3}, 1e-9, 2, true},
      {"permanent_set", "yield", {{0.5}, {1.0}}, {-0.3}, 1e-9, 2, true},
      {"permanent_set", "saturating", {{0.4}, {5.0}}, {-0.3}, 1e-9, 2, true},
      // The inside of a step is a parabola: its own file claims 1e-6. A sine of the pressure bends within a step.
      {"trapped_gas",
       "polytropic",
       {{0.5, 30.0, 1.2, 90.0}, {0.03, 22.0, 1.4, 60.0}, {50.0, 45.0, 1.0, 90.0}},
       {0.6},
       5e-3,
       2,
       false,
       true},
      {"friction_with_load", "capstan", {{0.02, 0.1}, {0.3, 0.6}}, {}, 1e-6, 2},
  };
  static const std::vector<Case> all = [] {
    std::vector<Case> both = named;
    std::ranges::copy(products(), std::back_inserter(both));
    return both;
  }();
  return all;
}

const Case* case_of(std::string_view physics, std::string_view law) {
  const auto found =
      std::ranges::find_if(cases(), [&](const Case& each) { return each.physics == physics && each.law == law; });
  return found == cases().end() ? nullptr : &*found;
}

std::vector<Named> every_law() {
  std::vector<Named> out;
  for (const auto list : {model::elements(), model::effects()})
    for (const model::Physics* physics : list)
      for (const model::Law& law : physics->laws) out.push_back({physics, &law});
  return out;
}

std::string test_name(const Named& named) {
  return std::string(named.physics->name) + "__" + std::string(named.law->name);
}

void PrintTo(const Named& named, std::ostream* out) {
  *out << test_name(named);
}

model::ModelSpec model_of(const Case& each, Numbers parameters) {
  model::ModelSpec spec{"case", {}};
  const auto add = [&spec](std::string_view physics, std::string_view law) -> model::Part& {
    const model::Physics* found = model::find_physics(physics);
    return spec.parts.emplace_back(model::make_part(*found, *model::find_law(*found, law)));
  };
  if (each.coefficients.empty()) {
    add("spring", "linear").coefficients[0] = 2.5;
    // A lag or a delay is exact for a force that runs straight: no arm before it.
    if (model::find_physics(each.physics)->stage < model::Stage::kSensorLag) {
      model::Part& arm = add("maxwell", "linear");
      arm.parameters[0] = 0.8;
      arm.coefficients[0] = 2.0;
    }
  }
  model::Part& part = add(each.physics, each.law);
  part.parameters.assign(parameters.begin(), parameters.end());
  part.coefficients = each.coefficients;
  if (part.law->make_table) part.table = some_table();
  return spec;
}

}  // namespace isorig::test
