#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "base/formatted.hpp"
#include "identify/pooling/pool.hpp"
#include "model/catalogue.hpp"
#include "model/number_sheet.hpp"
#include "model/words.hpp"

namespace isorig::identify::pooling {
namespace {

const model::NumberSheet* sheet_in(const model::Physics& physics, std::string_view law, const std::string& number) {
  if (const auto* named = model::find_law(physics, law)) return model::sheet_of(*named, number);
  for (const model::Law& any : physics.laws)
    if (const auto* sheet = model::sheet_of(any, number)) return sheet;
  return nullptr;
}

std::string unit_of(const model::NumberSheet* sheet) {
  std::string unit = model::unit_behind(sheet);
  if (unit.starts_with(' ')) unit.erase(0, 1);
  return unit;
}

bool is_event(const model::Physics& physics) {
  return std::ranges::any_of(physics.laws, [](const model::Law& law) { return model::is_event(law); });
}

class Chooser {
 public:
  Chooser(const PooledCampaign& campaign, std::vector<std::string>& not_compared)
      : campaign_(campaign), not_compared_(not_compared) {}

  std::vector<Quantity> run() {
    for (std::size_t r = 0; r < campaign_.recordings.size(); ++r) {
      for (const ReadEffect& effect : campaign_.recordings[r].missing) add_effect(r, effect);
      for (const ReadNumber& number : campaign_.recordings[r].nominal) add_nominal(r, number);
    }
    std::vector<Quantity> out;
    for (const std::string& key : order_) {
      Quantity& one = found_.at(key);
      std::set<std::size_t> actuators;
      for (const Measurement& m : one.measurements) actuators.insert(m.actuator);
      if (const std::size_t lost = without_interval_[key]; lost > 0)
        not_compared_.push_back(base::formatted("%s: %zu of %zu recordings state no interval for it", one.words.c_str(),
                                                lost, lost + one.measurements.size()));
      if (one.measurements.size() < 3 || actuators.size() < 2) {
        not_compared_.push_back(base::formatted("%s: in %zu %s of %zu %s, too few to pool", one.words.c_str(),
                                                one.measurements.size(),
                                                one.measurements.size() == 1 ? "recording" : "recordings",
                                                actuators.size(), actuators.size() == 1 ? "actuator" : "actuators"));
        continue;
      }
      out.push_back(std::move(one));
    }
    for (const auto& [words, count] : refused_)
      not_compared_.push_back(
          base::formatted("numbers of %s in %zu of the recordings that name it: its law predicts "
                          "readings that were left out worse there",
                          words.c_str(), count));
    return out;
  }

 private:
  void add_effect(std::size_t r, const ReadEffect& effect) {
    const model::Physics* physics = model::find_physics(effect.name);
    if (physics == nullptr) {
      say_once(effect.name + ": a name that this version of the catalogue does not have");
      return;
    }
    const std::string words = model::effect_words(effect.name);
    if (is_event(*physics)) {
      say_once("numbers of " + words + ": each belongs to an event of its recording");
      return;
    }
    if (effect.refused) {
      ++refused_[words];
      return;
    }
    if (effect.probability <= 0.5) return;
    for (const ReadNumber& number : effect.numbers) {
      const auto* sheet = sheet_in(*physics, effect.law, number.name);
      const std::string meaning = model::meaning_of(sheet), key = effect.name + "." + number.name;
      // Laws of one effect may use one name for numbers that mean different things: the first law keeps the name.
      const auto [at, fresh] = meaning_.try_emplace(key, meaning);
      const bool same = fresh || at->second == meaning;
      add(r, same ? key : key + "." + effect.law, effect.name, words + ": " + (meaning.empty() ? number.name : meaning),
          unit_of(sheet), number, effect.law);
    }
  }

  void add_nominal(std::size_t r, const ReadNumber& number) {
    const auto dot = number.name.find('.');
    std::string part = number.name.substr(0, dot), count;
    const std::string name = number.name.substr(dot + 1);
    if (const auto end = part.find_last_not_of("0123456789"); end + 1 < part.size() && part[end] == '_') {
      count = " " + part.substr(end + 1);
      part.resize(end);
    }
    const model::Physics* physics = model::find_physics(part);
    const auto* sheet = physics == nullptr ? nullptr : sheet_in(*physics, {}, name);
    const std::string meaning = model::meaning_of(sheet);
    add(r, number.name, {}, model::effect_words(part) + count + ": " + (meaning.empty() ? name : meaning),
        unit_of(sheet), number);
  }

  void add(std::size_t r, const std::string& key, const std::string& effect, const std::string& words,
           const std::string& unit, const ReadNumber& number, const std::string& law = {}) {
    const auto [at, fresh] = found_.try_emplace(key);
    if (fresh) {
      order_.push_back(key);
      at->second.key = key;
      at->second.effect = effect;
      at->second.words = words;
      at->second.unit = unit;
    }
    if (!std::isfinite(number.value) || !std::isfinite(number.standard_error)) {
      ++without_interval_[key];
      return;
    }
    at->second.measurements.push_back(
        {campaign_.actuator_of[r], campaign_.recordings[r].place.pressure_psi, number.value, number.standard_error});
    at->second.recording.push_back(r);
    at->second.law.push_back(law);
  }

  void say_once(const std::string& text) {
    if (std::ranges::find(not_compared_, text) == not_compared_.end()) not_compared_.push_back(text);
  }

  const PooledCampaign& campaign_;
  std::vector<std::string>& not_compared_;
  std::vector<std::string> order_;
  std::map<std::string, Quantity> found_;
  std::map<std::string, std::string> meaning_;
  std::map<std::string, std::size_t> without_interval_, refused_;
};

}  // namespace

std::vector<Quantity> choose_quantities(const PooledCampaign& campaign, std::vector<std::string>& not_compared) {
  auto out = Chooser(campaign, not_compared).run();
  // Those of effects first: they are what the nominal model lacks.
  std::stable_partition(out.begin(), out.end(), [](const Quantity& q) { return !q.effect.empty(); });
  return out;
}

}  // namespace isorig::identify::pooling
