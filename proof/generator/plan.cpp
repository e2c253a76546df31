#include <algorithm>
#include <array>

#include "proof/generator/case.hpp"
#include "proof/generator/deck.hpp"

namespace isorig::proof {

std::string_view name_of(Category category) {
  switch (category) {
    case Category::kNull:
      return "null";
    case Category::kSingle:
      return "single";
    case Category::kPair:
      return "pair";
    case Category::kTriple:
      return "triple";
    case Category::kConfusable:
      return "confusable";
    case Category::kOutOfCatalogue:
      return "out_of_catalogue";
    case Category::kBackground:
      return "background";
  }
  return "";
}

std::string_view name_of(Trap trap) {
  switch (trap) {
    case Trap::kNone:
      return "none";
    case Trap::kColouredNoise:
      return "coloured_noise";
    case Trap::kOutliers:
      return "outliers";
    case Trap::kCoarseQuantisation:
      return "coarse_quantisation";
    case Trap::kPressureClock:
      return "pressure_clock";
    case Trap::kWarmingNoise:
      return "warming_noise";
    case Trap::kNoisyPosition:
      return "noisy_position";
    case Trap::kNoPressure:
      return "no_pressure";
    case Trap::kSwingingPressure:
      return "swinging_pressure";
    case Trap::kGaps:
      return "gaps";
    case Trap::kMainsHum:
      return "mains_hum";
  }
  return "";
}

namespace {

std::vector<std::string> names(std::span<const EffectKind> kinds) {
  std::vector<std::string> list;
  for (const EffectKind& kind : kinds) list.emplace_back(kind.name);
  return list;
}

const std::array<std::vector<std::string>, 4> kClusters{{
    {"force_lag", "force_delay", "fixture_inertia"},
    {"coulomb_friction", "crosshead_backlash"},
    {"second_relaxation", "nonlinear_viscosity"},
    {"zero_drift", "cyclic_softening"},
}};

}  // namespace

bool alike(const std::string& a, const std::string& b) {
  return std::ranges::any_of(kClusters, [&](const auto& cluster) {
    return std::ranges::count(cluster, a) > 0 && std::ranges::count(cluster, b) > 0;
  });
}

std::vector<CasePlan> plan_study(std::uint64_t seed, std::size_t count) {
  Random random(seed, "plan");
  Deck<std::string> singles(names(named_effects()), random);
  Deck<std::string> behind_background(names(named_effects()), random);
  Deck<std::string> strange(names(strange_effects()), random);
  std::vector<std::string> mixable = names(named_effects());
  std::erase(mixable, "slack");  // it hides whatever else happens at the low end
  Deck<std::string> first(mixable, random);
  Deck<std::string> second(mixable, random);
  Deck<double> sizes({1.0, 1.0, 0.7, 0.5, 0.35, 0.25}, random);
  Deck<Trap> traps({Trap::kNone, Trap::kColouredNoise, Trap::kOutliers, Trap::kCoarseQuantisation, Trap::kPressureClock,
                    Trap::kWarmingNoise, Trap::kNoisyPosition, Trap::kNoPressure, Trap::kSwingingPressure, Trap::kGaps},
                   random);
  Deck<std::size_t> clusters({0, 1, 2, 3}, random);
  // Of 24: 5 nulls, 11 singles, 3 pairs, 1 confusable, 2 strange, 2 over a background.
  using enum Category;
  Deck<Category> categories(
      {kNull,   kNull,   kNull,   kNull,       kNull,           kSingle,         kSingle,     kSingle,
       kSingle, kSingle, kSingle, kSingle,     kSingle,         kSingle,         kSingle,     kSingle,
       kPair,   kPair,   kPair,   kConfusable, kOutOfCatalogue, kOutOfCatalogue, kBackground, kBackground},
      random);
  std::vector<CasePlan> plans(count);
  for (CasePlan& plan : plans) {
    plan.category = categories.next();
    switch (plan.category) {
      case kNull:
        plan.trap = traps.next();
        break;
      case kSingle:
        plan.effects = {singles.next()};
        plan.size = sizes.next();
        break;
      case kPair: {
        plan.effects = {first.next(), second.next()};
        while (plan.effects[0] == plan.effects[1] || alike(plan.effects[0], plan.effects[1]))
          plan.effects[1] = second.next();
        break;
      }
      case kTriple:  // the second generator's
        break;
      case kConfusable: {
        std::vector<std::string> cluster = kClusters[clusters.next()];
        random.shuffle(std::span(cluster));
        plan.effects = {cluster[0], cluster[1]};
        break;
      }
      case kOutOfCatalogue:
        plan.effects = {strange.next()};
        break;
      case kBackground:
        plan.effects = {behind_background.next()};
        plan.size = random.chance(0.5) ? 1.0 : 0.5;
        break;
    }
  }
  return plans;
}

}  // namespace isorig::proof
