#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "proof/generator/effects.hpp"
#include "proof/generator/instruments.hpp"

namespace isorig::proof {

/// What a case is there to show.
enum class Category {
  kNull,            ///< nothing concealed; sometimes a trap in the data
  kSingle,          ///< one named effect
  kPair,            ///< two that differ
  kTriple,          ///< three that differ
  kConfusable,      ///< two of one cluster: they look alike, or cancel
  kOutOfCatalogue,  ///< one that no catalogue has
  kBackground,      ///< one named effect over a faint error of the nominal model that nobody models
};
[[nodiscard]] std::string_view name_of(Category category);

struct CasePlan {
  Category category = Category::kNull;
  Trap trap = Trap::kNone;
  std::vector<std::string> effects;
  double size = 1.0;
};

struct Case {
  std::string name;
  CasePlan plan;
  std::string nominal;  ///< slse1 or slse2
  RigParameters clean;
  RigParameters rig;
  Instruments instruments;
  PaperProtocol train_protocol;
  HeldoutProtocol heldout_protocol;
  std::vector<ConcealedEffect> effects;
  double residual_over_noise = 0.0;
  double background_over_noise = 0.0;
};

/// Which cases a study of `count` holds: every kind in its share, every effect as often as every other.
[[nodiscard]] std::vector<CasePlan> plan_study(std::uint64_t seed, std::size_t count);

/// Whether two named effects look alike on these protocols; a pair of kPair has at most one of each cluster.
[[nodiscard]] bool alike(const std::string& a, const std::string& b);

/// Draws specimen, rig, instruments and effects, and finds the strengths.
[[nodiscard]] Case draw_case(std::uint64_t seed, std::size_t number, const CasePlan& plan);

enum class Part { kTrain, kHeldout };
/// The recording with everything its instruments do to it. A slip belongs to training alone: heldout is a
/// recording of its own, mounted anew.
[[nodiscard]] MadeRecording record(const Case& drawn, Part part, std::uint64_t seed);

}  // namespace isorig::proof
