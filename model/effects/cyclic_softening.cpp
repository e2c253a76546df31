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

const Parameter kTravel{
    .name = "travel_mm",
    .symbol = "s0",
    .lower = 1.0,
    .upper = 3e3,
    .starts = {8.0, 60.0},
    .logarithmic = true,
    .sheet = {
        .what = "Travel after which 63 % of what will be lost is lost.",
        .unit = "mm",
        .range = "Instrument: less than 1 mm is over within the first ramp, which cannot be told from a relaxation; 3 "
                 "m is 300 strokes over the whole travel of 10 mm, and the loss hardly bends within a recording.",
        .errors = "Starting on a specimen that was cycled before lengthens it. Mistaken for the time constant of a "
                  "drift when the motion is steady."}};
constexpr NumberSheet kLostSheet{
    .what = "Stiffness that is lost in the end; negative: the specimen becomes softer.",
    .unit = "N/mm",
    .range = "Physics: damage does not heal under load, so it is not positive.",
    .errors =
        "A drift of the force zero, or a slow relaxation that was not at rest at the start. "
        "Mistaken for zero_drift, which goes on when the motion stops."};

}  // namespace

const Physics& cyclic_softening() {
  static const Physics physics{
      "cyclic_softening",
      Stage::kSpecimen,
      "Stiffness lost with accumulated travel: Mullins effect, preconditioning not finished.",
      "Mullins 1948 (the effect); Miehe 1995 (continuous damage that saturates exponentially with what was travelled, "
      "there in strain energy, here in mm).",
      "The same slow triangle ten times over. Mistaken for a drift of the force zero, which goes on at rest.",
      {{"elastic",
        "F = dk e (1 - exp(-s / s0)), s travelled",
        {kTravel},
        {{.name = "lost_N_mm", .symbol = "dk", .sign = Sign::kNonPositive, .sheet = kLostSheet}},
        [](std::span<const double> p, const Reference&) {
          return std::make_unique<Softening>(Softening::Of::kElongation, p[0], 0.0);
        },
        {.counts = Counts::kTravel}},
       {"tangent",
        "F = dk x (1 - exp(-s / s0))",
        {kTravel},
        {{.name = "lost_N_mm", .symbol = "dk", .sign = Sign::kNonPositive, .sheet = kLostSheet}},
        [](std::span<const double> p, const Reference&) {
          return std::make_unique<Softening>(Softening::Of::kPosition, p[0], 0.0);
        },
        {.counts = Counts::kTravel}},
       // Nothing linear is left here: the share scales elastic and viscous force alike.
       {"overall",
        "F = F_specimen (1 - a (1 - exp(-s / s0)))",
        {kTravel,
         {.name = "share",
          .symbol = "a",
          .lower = 0.0,
          .upper = 0.9,
          .starts = {0.03},
          .sheet = {.what = "Share of the specimen's whole force, elastic and viscous, that is lost in the end.",
                    .unit = "1",
                    .range = "Physics: damage does not heal under load, so it is not negative; what has lost more than "
                             "nine tenths is torn, not softened.",
                    .errors = "A tare that is wrong, since the share is of the force of the specimen alone. Mistaken "
                              "for a loss of stiffness where the force is nearly elastic."}}},
        {},
        [](std::span<const double> p, const Reference&) {
          return std::make_unique<Softening>(Softening::Of::kAll, p[0], p[1]);
        },
        {.scales_specimen = true, .counts = Counts::kTravel}}},
      {.acts_on = "elastic branch",
       .depends_on = {"history"},
       .shape_of = ShapeOf::kTravel,
       .words = "softening with use"}};
  return physics;
}

}  // namespace isorig::model::effect
