#include "model/catalogue.hpp"

#include <algorithm>
#include <array>

#include "model/effects/effects.hpp"
#include "model/elements.hpp"

namespace isorig::model {

std::span<const Physics* const> elements() {
  static const std::array all{&element::spring(),
                              &element::maxwell(),
                              &element::arm_start(),
                              &element::dashpot(),
                              &element::mass(),
                              &element::constant(),
                              &element::force_zero(),
                              &element::gravity(),
                              &element::empirical_force(),
                              &element::empirical_motion(),
                              &element::empirical_memory(),
                              &element::empirical_response(),
                              &element::discovered()};
  return all;
}

std::span<const Physics* const> effects() {
  static const std::array all{
#define ISORIG_EFFECT(name) &effect::name(),
#include "model/effects/list.inc"
#undef ISORIG_EFFECT
  };
  return all;
}

const Physics* find_physics(std::string_view name) {
  for (const auto list : {elements(), effects()}) {
    const auto found = std::ranges::find_if(list, [name](const Physics* p) { return p->name == name; });
    if (found != list.end()) return *found;
  }
  return nullptr;
}

const Law* find_law(const Physics& physics, std::string_view law) {
  const auto found = std::ranges::find_if(physics.laws, [law](const Law& l) { return l.name == law; });
  return found == physics.laws.end() ? nullptr : &*found;
}

bool is_effect(const Physics& physics) {
  const auto list = effects();
  return std::ranges::find(list, &physics) != list.end();
}

bool is_empirical(const Physics& physics) {
  return &physics == &element::empirical_force() || &physics == &element::empirical_motion() ||
         &physics == &element::empirical_memory() || &physics == &element::empirical_response() ||
         &physics == &element::discovered();
}

std::string_view side_of(Stage stage) noexcept {
  switch (stage) {
    case Stage::kKinematics:
      return "kinematics";
    case Stage::kSpecimen:
    case Stage::kSpecimenShape:
      return "specimen";
    case Stage::kRig:
      return "rig";
    case Stage::kSensorLag:
    case Stage::kSensorDelay:
    case Stage::kSensor:
      return "sensor";
  }
  return "";
}

}  // namespace isorig::model
