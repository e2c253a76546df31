#pragma once
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "identify/diagnose/study.hpp"

namespace isorig::identify {

struct DiagnosisOptions {
  unsigned threads = 2;
  SelectionOptions selection;
  DesignOptions design;
  /// Effects that the search does not try (search/hypothesis.hpp).
  std::vector<const model::Physics*> withheld{};
  /// Called as the work goes on: the part that is done, by the time that its stages take of a usual diagnosis, and what
  /// comes now.
  std::function<void(double fraction, const char* doing)> on_progress{};
};

/// Throws std::invalid_argument for recordings that cannot be judged, or not together (guard/plausible.hpp),
/// std::domain_error when the numbers that the verdict rests on do not come out finite.
[[nodiscard]] Study diagnose(std::vector<messages::Recording> recordings, std::vector<std::string> names,
                             const model::ModelSpec& nominal, const DiagnosisOptions& options);

[[nodiscard]] nlohmann::ordered_json diagnosis_json(const Diagnosis& diagnosis);

}  // namespace isorig::identify
