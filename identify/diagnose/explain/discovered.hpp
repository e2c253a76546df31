#pragma once
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "identify/diagnose/fit/intervals.hpp"

namespace isorig::identify {

/// A product that the search put in the place of physics without a name (search/discovery.hpp).
struct DiscoveredLaw {
  std::string law;      ///< of model::element::discovered(): "arm_position"
  std::string acts_on;  ///< as effects have it: "arm"
  std::vector<std::string> depends_on;
  std::string formula;  ///< with its numbers
  std::vector<NamedValue> parameters;
  double inclusion_probability = 0.0;
  std::string in_words;  ///< "the force of an arm times (1 + 0.12 x)", with what it changes with
};

/// The products of a model, in its order. `numbers` as intervals() gives them for it, `inclusion` by the law's name.
///
/// A product whose state pulls in the model by itself too, with the coefficient k and the same time constant or
/// presliding to within a fifth, changes that force by the factor 1 + c/k u; in_words says so.
[[nodiscard]] std::vector<DiscoveredLaw> discovered_laws(const model::ModelSpec& spec,
                                                         const std::vector<std::vector<NamedValue>>& numbers,
                                                         const std::map<std::string, double>& inclusion);

/// How unknown physics is described, for people: "a law was found for it: friction grows with the position: times
/// (1 + 0.1 x)", without a law "it is described as a function of the rate". "" for neither.
[[nodiscard]] std::string described_in_words(const std::vector<DiscoveredLaw>& laws, const std::string& function_of);

}  // namespace isorig::identify
