#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

class Softening : public Process {
 public:
  enum class Of { kElongation, kPosition, kAll };
  Softening(Of of, double travel_mm, double share) noexcept : of_(of), travel_mm_(travel_mm), share_(share) {}
  void reset(const Instant&) noexcept override { travelled_mm_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    travelled_mm_ += std::fabs(now.step_mm);
    columns[0] = lost() * (of_ == Of::kElongation ? now.elongation_mm : now.position_mm);
  }
  void shape(const Instant& now, std::span<double> columns, std::span<const double>) noexcept override {
    travelled_mm_ += std::fabs(now.step_mm);
    const double factor = 1.0 - share_ * lost();
    for (double& column : columns) column *= factor;
  }

 private:
  [[nodiscard]] double lost() const noexcept { return -std::expm1(-travelled_mm_ / travel_mm_); }
  Of of_;
  double travel_mm_;
  double share_;
  double travelled_mm_ = 0.0;
};

const Parameter kTravel{"travel_mm", 1.0, 3e3, {8.0, 60.0}, true};

}  // namespace

const Physics& cyclic_softening() {
  static const Physics physics{
      "cyclic_softening",
      Stage::kSpecimen,
      "Stiffness lost with accumulated travel: Mullins effect, preconditioning not finished.",
      "Mullins 1948; exponential in travel as in Dorfmann & Ogden's damage variable for repeated cycles.",
      "The same slow triangle ten times over. Mistaken for a drift of the force zero, which goes on at rest.",
      {{"elastic",
        "F = -dk e (1 - exp(-s / s0)), s travelled",
        {kTravel},
        {{"lost_N_mm", Sign::kNonPositive}},
        [](std::span<const double> p, const Reference&) {
          return std::make_unique<Softening>(Softening::Of::kElongation, p[0], 0.0);
        },
        {.counts = Counts::kTravel}},
       {"tangent",
        "F = -dk x (1 - exp(-s / s0))",
        {kTravel},
        {{"lost_N_mm", Sign::kNonPositive}},
        [](std::span<const double> p, const Reference&) {
          return std::make_unique<Softening>(Softening::Of::kPosition, p[0], 0.0);
        },
        {.counts = Counts::kTravel}},
       // Nothing linear is left here: the share scales elastic and viscous force alike.
       {"overall",
        "F = F_specimen (1 - a (1 - exp(-s / s0)))",
        {kTravel, {"share", 0.0, 0.9, {0.03}}},
        {},
        [](std::span<const double> p, const Reference&) {
          return std::make_unique<Softening>(Softening::Of::kAll, p[0], p[1]);
        },
        {.scales_specimen = true, .counts = Counts::kTravel}}}};
  return physics;
}

}  // namespace isorig::model::effect
