#include <algorithm>
#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// max(0, xi - yield), or 1 - exp of it where it saturates; xi as below.
class Set : public Process {
 public:
  Set(double yield_mm, double scale_mm) noexcept : yield_mm_(yield_mm), scale_mm_(scale_mm) {}
  void reset(const Instant& first) noexcept override { start_mm_ = largest_mm_ = first.position_mm; }
  void force(const Instant& now, double* columns) noexcept override {
    largest_mm_ = std::max(largest_mm_, now.position_mm);
    const double beyond_mm = std::max(0.0, largest_mm_ - start_mm_ - yield_mm_);
    columns[0] = scale_mm_ > 0.0 ? -std::expm1(-beyond_mm / scale_mm_) : beyond_mm;
  }

 private:
  double yield_mm_;
  double scale_mm_;  ///< 0: it does not saturate
  double start_mm_ = 0.0;
  double largest_mm_ = 0.0;
};

const Parameter kYield{.name = "yield_mm",
                       .symbol = "y",
                       .lower = 0.0,
                       .upper = 100.0,
                       .starts = {0.0, 1.0},
                       .sheet = {.what = "Stretch beyond the start up to which nothing is lost.",
                                 .unit = "mm",
                                 .range = "Physics: a stretch is not negative; 100 mm is a specimen's length.",
                                 .errors = "The history before the recording is taken to have ended at its start: a "
                                           "larger one lowers it. Mistaken for a slip at one instant."}};

}  // namespace

/// Permanent set: the rest length grows with the largest stretch of the history and does not come back, so that the
/// same position is reached with less force. An elastic force k (e - ep) with the set ep is the nominal spring's k e
/// and beside it F = -k ep, which this effect adds. xi >= 0 is the largest position so far minus that at the start of
/// the recording:
///   `proportional`  F = -h xi
///   `yield`         F = -h max(0, xi - y): nothing is lost up to y
///   `saturating`    F = -F0 (1 - exp(-xi / s))
/// Signs: h, F0 >= 0 as losses, hence coefficients <= 0; only extension lengthens. The set is ep = -F / k.
/// Units: h N/mm, F0 N, xi, y and s mm. Range: up to 100 mm, a specimen's length.
/// Unlike mullins_softening the loss is a force and not a share of the stiffness: it is the same at every position once
/// it is there. The history before the recording is not known and taken to have ended at its start.
/// Errors: exact at every sample if the motion reverses only at samples. Plastic, hence never passive by itself: the
/// work is taken from the spring beside it. Sources: Dorfmann & Ogden 2004, Int. J. Solids Struct. 41:1855; Guo & Sluys
/// 2008, HERON 53(3).
const Physics& permanent_set() {
  static const Physics physics{
      "permanent_set",
      Stage::kSpecimen,
      "Rest length that grows with the largest stretch and does not come back.",
      "Dorfmann & Ogden 2004, Int. J. Solids Struct. 41:1855; Guo & Sluys 2008, HERON 53(3) (Mullins effect with "
      "permanent deformation).",
      "Slow triangles whose amplitude grows, with rests at one position between them: the force at rest falls after "
      "each "
      "larger one and stays. Mistaken for mullins_softening (which takes a share of the stiffness), grip_slip (at one "
      "instant, at any strain) and zero_drift (which goes on at rest).",
      {{"proportional",
        "F = h xi, xi largest position so far minus that at the start",
        {},
        {{.name = "lost_N_mm",
          .symbol = "h",
          .sign = Sign::kNonPositive,
          .sheet =
              {.what = "Force lost per mm of the largest stretch; over the spring's stiffness it is the set per mm.",
               .unit = "N/mm",
               .range = "Physics: a set takes force away, so it is not positive; no lower bound.",
               .errors =
                   "Stretches of one size cannot separate it from the tare. Mistaken for mullins_softening and for "
                   "a drift of the zero."}}},
        [](auto, const Reference&) { return std::make_unique<Set>(0.0, 0.0); },
        {.counts = Counts::kLargestStrain}},
       {"yield",
        "F = h max(0, xi - y)",
        {kYield},
        {{.name = "lost_N_mm",
          .symbol = "h",
          .sign = Sign::kNonPositive,
          .sheet = {.what = "Force lost per mm of the largest stretch beyond the yield.",
                    .unit = "N/mm",
                    .range = "Physics: a set takes force away, so it is not positive; no lower bound.",
                    .errors =
                        "Stretches of one size cannot separate it from the yield. Mistaken for mullins_softening and "
                        "for a drift of the zero."}}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Set>(p[0], 0.0); },
        {.counts = Counts::kLargestStrain}},
       {"saturating",
        "F = F0 (1 - exp(-xi / s))",
        {{.name = "scale_mm",
          .symbol = "s",
          .lower = 0.05,
          .upper = 100.0,
          .starts = {1.0},
          .logarithmic = true,
          .sheet = {.what = "Growth of the largest stretch over which most of the loss happens.",
                    .unit = "mm",
                    .range = "Instrument: below 0.05 mm the first reading beyond the start has it all; 100 mm is a "
                             "specimen's length.",
                    .errors = "One size of stretch cannot separate it from the loss. Mistaken for a yield."}}},
        {{.name = "lost_N",
          .symbol = "F0",
          .sign = Sign::kNonPositive,
          .sheet = {.what = "Force that is lost in the end.",
                    .unit = "N",
                    .range = "Physics: a set takes force away, so it is not positive; no lower bound.",
                    .errors = "Stretches far below the scale cannot separate it from it. Mistaken for a slip or a "
                              "drift of the zero."}}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Set>(0.0, p[0]); },
        {.counts = Counts::kLargestStrain}}},
      {.unusual = true,
       .needs_any_of = {"spring"},
       .acts_on = "elastic branch",
       .depends_on = {"history"},
       .shape_of = ShapeOf::kLoop,
       .words = "permanent set"}};
  return physics;
}

}  // namespace isorig::model::effect
