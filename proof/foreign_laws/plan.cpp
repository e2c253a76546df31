#include <algorithm>

#include "proof/foreign_laws/case.hpp"
#include "proof/generator/deck.hpp"

namespace isorig::proof::foreign {
namespace {

std::string effect_of(const std::string& law) {
  return std::string(kind_of_law(law).effect);
}

/// Two that a recording can tell apart: neither one name, nor names that look alike, nor one that hides the other.
bool apart(const std::string& law, const std::string& other) {
  const std::string a = effect_of(law), b = effect_of(other);
  const auto accepts = [](const std::string& one, const std::string& name) {
    return std::ranges::count(kind_of_law(one).accepted, name) > 0;
  };
  return a != b && !alike(a, b) && !accepts(law, b) && !accepts(other, a);
}

}  // namespace

std::vector<CasePlan> plan_study(std::uint64_t seed, std::size_t count) {
  Random random(seed, "foreign plan");
  // Every effect as often as every other, every law of an effect as often as its other laws.
  std::map<std::string, std::vector<std::string>> laws;
  std::vector<std::string> unknown;
  for (const Kind& kind : kinds())
    (kind.effect == kUnknown ? unknown : laws[std::string(kind.effect)]).emplace_back(kind.law);
  std::vector<std::string> effects, mixable;
  std::map<std::string, Deck<std::string>> law_of;
  for (auto& [effect, list] : laws) {
    effects.push_back(effect);
    if (effect != "slack") mixable.push_back(effect);  // it hides whatever else happens at the low end
    law_of.emplace(effect, Deck<std::string>(list, random));
  }
  Deck<std::string> singles(effects, random), behind(mixable, random), mixed(mixable, random);
  Deck<std::string> outside(unknown, random);
  Deck<double> sizes({1.0, 0.5, 0.25}, random);
  Deck<double> mixed_sizes({1.0, 0.5, 0.25}, random);
  Deck<double> outside_sizes({1.0, 0.5}, random);
  using enum Trap;
  Deck<Trap> traps({kNone, kColouredNoise, kMainsHum, kOutliers, kCoarseQuantisation, kPressureClock, kWarmingNoise,
                    kNoisyPosition, kNoPressure, kSwingingPressure, kGaps},
                   random);
  using enum Category;
  Deck<Category> categories(
      {kNull,   kNull,   kNull,   kNull,       kNull,       kNull,           kSingle,         kSingle,
       kSingle, kSingle, kSingle, kSingle,     kSingle,     kSingle,         kSingle,         kPair,
       kPair,   kPair,   kTriple, kBackground, kBackground, kOutOfCatalogue, kOutOfCatalogue, kOutOfCatalogue},
      random);
  const auto mix = [&](std::size_t size) {
    std::vector<std::string> chosen;
    while (chosen.size() < size) {
      const std::string law = law_of.at(mixed.next()).next();
      if (std::ranges::all_of(chosen, [&](const std::string& other) { return apart(law, other); }))
        chosen.push_back(law);
    }
    return chosen;
  };
  std::vector<CasePlan> plans(count);
  for (CasePlan& plan : plans) {
    plan.category = categories.next();
    switch (plan.category) {
      case kNull:
        plan.trap = traps.next();
        break;
      case kSingle:
        plan.effects = {law_of.at(singles.next()).next()};
        plan.size = sizes.next();
        break;
      case kBackground:
        plan.effects = {law_of.at(behind.next()).next()};
        plan.size = sizes.next();
        break;
      case kPair:
      case kConfusable:
        plan.effects = mix(2);
        plan.size = mixed_sizes.next();
        break;
      case kTriple:
        plan.effects = mix(3);
        plan.size = mixed_sizes.next();
        break;
      case kOutOfCatalogue:
        plan.effects = {outside.next()};
        plan.size = outside_sizes.next();
        break;
    }
  }
  return plans;
}

}  // namespace isorig::proof::foreign
