#include <algorithm>
#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// The largest elongation so far, either way. Exact on monotone steps: it is reached at the end of one.
class LargestElongation {
 public:
  void reset(const Instant& first) noexcept { start_mm_ = largest_mm_ = std::fabs(first.elongation_mm); }
  void see(const Instant& now) noexcept { largest_mm_ = std::max(largest_mm_, std::fabs(now.elongation_mm)); }
  [[nodiscard]] double mm() const noexcept { return largest_mm_; }
  [[nodiscard]] double beyond_start_mm() const noexcept { return largest_mm_ - start_mm_; }

 private:
  double start_mm_ = 0.0;
  double largest_mm_ = 0.0;
};

class PseudoElastic : public Process {
 public:
  explicit PseudoElastic(double scale_mm) noexcept : scale_mm_(scale_mm) {}
  void reset(const Instant& first) noexcept override { largest_.reset(first); }
  void force(const Instant& now, double* columns) noexcept override {
    largest_.see(now);
    const double e = now.elongation_mm, most = largest_.mm();
    columns[0] = e * std::erf((most - e) * (most + e) / (scale_mm_ * scale_mm_));
  }

 private:
  double scale_mm_;
  LargestElongation largest_;
};

class Damage : public Process {
 public:
  explicit Damage(double scale_mm) noexcept : scale_mm_(scale_mm) {}
  void reset(const Instant& first) noexcept override { largest_.reset(first); }
  void force(const Instant& now, double* columns) noexcept override {
    largest_.see(now);
    columns[0] = -std::expm1(-largest_.beyond_start_mm() / scale_mm_) * now.elongation_mm;
  }

 private:
  double scale_mm_;
  LargestElongation largest_;
};

const Coefficient kLost{
    .name = "lost_N_mm",
    .symbol = "dk",
    .sign = Sign::kNonPositive,
    .sheet = {.what = "Stiffness that is lost when the largest elongation is far behind.",
              .unit = "N/mm",
              .range =
                  "Physics: softening takes from the spring, so it is not positive; that it takes no more than the "
                  "spring has is seen in the fit and not enforced.",
              .errors = "One amplitude cannot separate it from the scale. Mistaken for strain_stiffening after the "
                        "first loading."}};

}  // namespace

/// Mullins softening by the largest strain of the history: after a stretch the specimen is softer at smaller strains;
/// beyond the largest strain so far it is as stiff as a new one. Repetition at the same amplitude changes nothing more,
/// which is where cyclic_softening (by travel) differs.
///   `ogden_roxburgh`  pseudo-elastic: F = k e (1 - 1/r erf((Wm - W) / m)) with W = k e^2 / 2, Wm its largest value;
///                     written with lost = -k / r and s^2 = 2 m / k: F = lost e erf((em^2 - e^2) / s^2)
///   `damage`          F = lost e (1 - exp(-xi / s)), xi how far the largest |e| lies beyond that at the start (Simo's
///                     discontinuous damage, which holds on first loading, too)
/// Signs: e elongation from the pressurized rest length, positive in extension; lost <= 0 takes from the spring and may
/// not be more than it (r >= 1), which a fit shows and does not enforce. Units: lost N/mm, s mm.
/// Range: s from 0.05 mm (below that the first reading beyond the start has it all) to 100 mm, a specimen's length.
/// The history before the recording is not known: the largest strain before it is taken to be that at its start.
/// Errors: exact at every sample if the motion reverses only at samples. Not passive by itself: it takes force from the
/// spring beside it. Sources: Ogden & Roxburgh 1999, Proc. R. Soc. A 455:2861; Simo 1987, Comput. Methods Appl. Mech.
/// Eng. 60:153.
const Physics& mullins_softening() {
  static const Physics physics{
      "mullins_softening",
      Stage::kSpecimen,
      "Stiffness lost to the largest strain of the history, not to repetition.",
      "Ogden & Roxburgh 1999, Proc. R. Soc. A 455:2861 (pseudo-elastic); Simo 1987 (damage by the largest strain).",
      "Slow triangles whose amplitude grows: each first loading leaves the curve of the one before at its largest "
      "strain, "
      "and a second triangle of the same size retraces the unloading. Mistaken for cyclic_softening (by travel) when "
      "the first triangle is the largest, for permanent_set, and for strain_stiffening after the first loading.",
      {{"ogden_roxburgh",
        "F = dk e erf((em^2 - e^2) / s^2), em largest |e| so far",
        {{.name = "scale_mm",
          .symbol = "s",
          .lower = 0.05,
          .upper = 100.0,
          .starts = {3.0, 15.0},
          .logarithmic = true,
          .sheet = {.what = "How far back from its largest elongation the specimen has lost most of what it loses.",
                    .unit = "mm",
                    .range = "Instrument: below 0.05 mm the first reading beyond the start has it all; 100 mm is a "
                             "specimen's length.",
                    .errors = "A first triangle that is the largest cannot separate it from the loss. Mistaken for the "
                              "travel of cyclic_softening."}}},
        {kLost},
        [](std::span<const double> p, const Reference&) { return std::make_unique<PseudoElastic>(p[0]); },
        {.counts = Counts::kLargestStrain}},
       {"damage",
        "F = dk e (1 - exp(-xi / s)), xi largest |e| beyond that at the start",
        {{.name = "scale_mm",
          .symbol = "s",
          .lower = 0.05,
          .upper = 100.0,
          .starts = {1.0},
          .logarithmic = true,
          .sheet = {.what = "Growth of the largest elongation over which most of the loss happens.",
                    .unit = "mm",
                    .range = "Instrument: below 0.05 mm the first reading beyond the start has it all; 100 mm is a "
                             "specimen's length.",
                    .errors = "The history before the recording is unknown, and part of the loss may lie in it. "
                              "Mistaken for the travel of cyclic_softening."}}},
        {kLost},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Damage>(p[0]); },
        {.counts = Counts::kLargestStrain}}},
      {.unusual = true,
       .needs_any_of = {"spring"},
       .acts_on = "elastic branch",
       .depends_on = {"history", "strain"},
       .shape_of = ShapeOf::kLoop,
       .words = "softening by the largest stretch so far"}};
  return physics;
}

}  // namespace isorig::model::effect
