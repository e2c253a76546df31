#include "identify/diagnose/explain/discovered.hpp"

#include <algorithm>
#include <cmath>

#include "base/formatted.hpp"
#include "identify/diagnose/explain/shape.hpp"
#include "model/catalogue.hpp"
#include "model/discovered.hpp"
#include "model/elements.hpp"

namespace isorig::identify {
namespace {

using model::Part;

/// The same state: an arm of the same time constant, a bristle of the same presliding.
bool alike(const Part& a, const Part& b) {
  constexpr double kAlike = 0.2;
  if (a.parameters.empty() || b.parameters.empty()) return a.parameters.empty() == b.parameters.empty();
  return std::fabs(std::log(a.parameters[0] / b.parameters[0])) < kAlike;
}

/// Whether the part exerts the force of the product's state in proportion to one coefficient, with no other factor: an
/// element, the product library's law without a factor, or an effect on the same element with a law of that form.
bool is_alone(const Part& part, const Part& product, const model::ProductWords& words) {
  if (part.physics == product.physics)
    return part.law->name == std::string(words.carrier) + "_alone" && alike(part, product);
  if (words.carrier == "elastic") return part.physics == &model::element::spring();
  if (words.carrier == "arm") return part.physics == &model::element::maxwell() && alike(part, product);
  if (words.carrier == "dashpot" && part.physics == &model::element::dashpot()) return true;
  const auto& depends_on = part.physics->traits.depends_on;
  const bool same_state = part.physics->traits.acts_on == words.acts_on && !depends_on.empty() &&
                          !words.depends_on.empty() && depends_on[0] == words.depends_on[0];
  return same_state && part.law == &part.physics->laws[0] && part.coefficients.size() == 1 && alike(part, product);
}

/// Coefficient of the force that the product's state exerts without the factor; 0 where the model has none.
double coefficient_alone(const model::ModelSpec& spec, const Part& product, const model::ProductWords& words) {
  double sum = 0.0;
  for (const Part& part : spec.parts)
    if (is_alone(part, product, words)) sum += part.coefficients[0];
  return sum;
}

std::string words_of(const model::ModelSpec& spec, const Part& part) {
  const model::ProductWords words = model::product_words(part.law->name);
  const double c = part.coefficients[0];
  std::string which;
  if (words.carrier == "arm") which = base::formatted(" of %.3g s", part.parameters[0]);
  const std::string force = words.force + which;
  // Not the name of an effect: the search has weighed those, and none of them was credible.
  if (words.by.empty()) return "a force like " + force + " is missing";
  const double alone = coefficient_alone(spec, part, words);
  if (alone != 0.0 && std::isfinite(c / alone))
    return base::formatted("%s %s with %s: times (1 %c %.3g %s)", force.c_str(), c / alone > 0.0 ? "grows" : "falls",
                           words.by.c_str(), c / alone > 0.0 ? '+' : '-', std::fabs(c / alone), words.symbol.c_str());
  return base::formatted("%s in proportion to %s is missing", force.c_str(), words.by.c_str());
}

}  // namespace

std::string described_in_words(const std::vector<DiscoveredLaw>& laws, const std::string& function_of) {
  if (laws.empty()) return function_of.empty() ? "" : "it is described as a function of " + function_of;
  std::string out;
  for (const DiscoveredLaw& law : laws) out += (out.empty() ? "a law was found for it: " : "; ") + law.in_words;
  return out;
}

std::vector<DiscoveredLaw> discovered_laws(const model::ModelSpec& spec,
                                           const std::vector<std::vector<NamedValue>>& numbers,
                                           const std::map<std::string, double>& inclusion) {
  std::vector<DiscoveredLaw> out;
  for (std::size_t p = 0; p < spec.parts.size(); ++p) {
    const Part& part = spec.parts[p];
    if (part.physics != &model::element::discovered()) continue;
    const model::ProductWords words = model::product_words(part.law->name);
    DiscoveredLaw one;
    one.law = part.law->name;
    one.acts_on = words.acts_on;
    one.depends_on.assign(words.depends_on.begin(), words.depends_on.end());
    one.formula = formula_text(*part.law, numbers[p]);
    one.parameters = numbers[p];
    const auto found = inclusion.find(one.law);
    one.inclusion_probability = found == inclusion.end() ? 0.0 : std::min(found->second, 1.0);
    one.in_words = words_of(spec, part);
    out.push_back(std::move(one));
  }
  return out;
}

}  // namespace isorig::identify
