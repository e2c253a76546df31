#include <algorithm>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// The specimen's own force ends at zero: its columns count nothing while their sum would push.
class Slack : public Process {
 public:
  void reset(const Instant&) noexcept override {}
  void shape(const Instant&, std::span<double> columns, std::span<const double> coefficients) noexcept override {
    double force_N = 0.0;
    for (std::size_t i = 0; i < columns.size(); ++i) force_N += columns[i] * coefficients[i];
    if (force_N < 0.0) std::ranges::fill(columns, 0.0);
  }
};

}  // namespace

const Physics& slack() {
  static const Physics physics{
      "slack",
      Stage::kSpecimenShape,
      "A specimen that cannot push: force ends at zero.",
      "A mesh and its Kevlar ties carry tension only, as a cable does (Irvine 1981).",
      "Shorten beyond the pressurized rest length: the force stays at zero. "
      "Mistaken for a saturated load cell.",
      {{"unilateral",
        "F = max(0, F_specimen)",
        {},
        {},
        [](auto, const Reference&) { return std::make_unique<Slack>(); },
        {.uses_coefficients = true}}},
      {.acts_on = "elastic branch", .depends_on = {"strain"}, .shape_of = ShapeOf::kPosition, .words = "slack"}};
  return physics;
}

}  // namespace isorig::model::effect
