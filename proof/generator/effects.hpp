#pragma once
#include <map>
#include <span>
#include <string>
#include <string_view>

#include "proof/generator/random.hpp"
#include "proof/generator/rig.hpp"

namespace isorig::proof {

/// One kind of thing to conceal. Its strength is one number, the size scale of the study; everything else
/// about it (laws, places, times) is its shape and is drawn with the case.
struct EffectKind {
  std::string_view name;
  std::string_view strength;  ///< what the strength is, with its unit
  double start = 0.0;         ///< where the search for the full size begins
  double most = 0.0;          ///< what a rig could have at the utmost
  bool in_catalogue = true;
};

/// The thirteen names of the recording format.
[[nodiscard]] std::span<const EffectKind> named_effects();
/// Physics that no catalogue is likely to hold.
[[nodiscard]] std::span<const EffectKind> strange_effects();
[[nodiscard]] const EffectKind& effect_kind(std::string_view name);

struct ConcealedEffect {
  std::string name;
  double strength = 0.0;
  double size = 1.0;  ///< share of the full strength
  std::map<std::string, double> shape;
};

/// Draws the shape, given where the ramps are.
[[nodiscard]] ConcealedEffect draw_effect(const EffectKind& kind, Random& random, const RigParameters& rig,
                                          const Motion& train);
/// Adds it to the rig.
void conceal(const ConcealedEffect& effect, RigParameters& rig);

}  // namespace isorig::proof
