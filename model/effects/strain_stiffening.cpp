#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

/// x^lowest to x^highest.
class Powers : public Process {
 public:
  Powers(int lowest, int highest) noexcept : lowest_(lowest), highest_(highest) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    const double x = now.position_mm;
    double power = x;
    for (int degree = 2; degree <= highest_; ++degree) {
      power *= x;
      if (degree >= lowest_) *columns++ = power;
    }
  }

 private:
  int lowest_;
  int highest_;
};

class Exponential : public Process {
 public:
  explicit Exponential(double length_mm) noexcept : length_mm_(length_mm) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    const double u = now.position_mm / length_mm_;
    columns[0] = length_mm_ * (std::expm1(u) - u);
  }

 private:
  double length_mm_;
};

class Knee : public Process {
 public:
  explicit Knee(double position_mm) noexcept : position_mm_(position_mm) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = std::fmax(0.0, now.position_mm - position_mm_);
  }

 private:
  double position_mm_;
};

/// A knee that bends over a width: fibres that take up their load one after the other (a spread of lengths
/// that is logistic).
class SmoothKnee : public Process {
 public:
  SmoothKnee(double position_mm, double width_mm) noexcept : position_mm_(position_mm), width_mm_(width_mm) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    const double u = (now.position_mm - position_mm_) / width_mm_;
    columns[0] = width_mm_ * (std::fmax(u, 0.0) + std::log1p(std::exp(-std::fabs(u))));
  }

 private:
  double position_mm_;
  double width_mm_;
};

/// Extension that ends: F = k L u^2 / (1 - u), u = x / L. A braid locks where its fibres lie side by side and their
/// angle to the axis is the least (Chou & Hannaford 1996); near a limit of extension the force goes as one over the
/// distance to it (Gent 1996). In small extension it is k x^2 / L, k in N/mm. L in mm from the rest position; it lies
/// beyond the largest position recorded, which the data ask for and no bound enforces. Up to 0.99 of L; beyond that the
/// force stays as it is there.
class Lock : public Process {
 public:
  explicit Lock(double lock_mm) noexcept : lock_mm_(lock_mm) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    constexpr double kNearest = 0.99;
    const double u = std::fmin(now.position_mm / lock_mm_, kNearest);
    columns[0] = lock_mm_ * u * u / (1.0 - u);
  }

 private:
  double lock_mm_;
};

const Coefficient kQuadratic{
    .name = "quadratic_N_mm2",
    .symbol = "k2",
    .sign = Sign::kFree,
    .sheet = {.what = "Half of the change of stiffness per mm; positive: stiffer in extension.",
              .unit = "N/mm2",
              .range = "Physics: a specimen may stiffen or soften with strain, so it has no sign.",
              .errors = "Friction whose loop is not straight puts its mean here. Mistaken for the curvature of a load "
                        "cell, which bends relaxation too."}};
const Coefficient kCubic{
    .name = "cubic_N_mm3",
    .symbol = "k3",
    .sign = Sign::kFree,
    .sheet = {.what = "A third of the stiffness that is added 1 mm from the origin; positive: stiffer at both ends.",
              .unit = "N/mm3",
              .range = "Physics: a specimen may stiffen or soften with strain, so it has no sign.",
              .errors = "A stroke to one side cannot separate it from the quadratic term. Mistaken for slack at one "
                        "end of the stroke."}};
const Coefficient kQuartic{
    .name = "quartic_N_mm4",
    .symbol = "k4",
    .sign = Sign::kFree,
    .sheet = {.what = "A quarter of the stiffness that the fourth power adds 1 mm from the origin.",
              .unit = "N/mm4",
              .range = "Physics: a specimen may stiffen or soften with strain, so it has no sign.",
              .errors = "Means little without the other powers: they share one curve, and a shift of the origin moves "
                        "parts of it between them. Mistaken for a law of fewer numbers, which is preferred."}};
const Coefficient kQuintic{
    .name = "quintic_N_mm5",
    .symbol = "k5",
    .sign = Sign::kFree,
    .sheet = {.what = "A fifth of the stiffness that the fifth power adds 1 mm from the origin.",
              .unit = "N/mm5",
              .range = "Physics: a specimen may stiffen or soften with strain, so it has no sign.",
              .errors =
                  "As of the fourth power. Beyond the stroke it grows as no specimen does: a prediction returns to "
                  "the nominal model there."}};
const Parameter kKneePosition{
    .name = "position_mm",
    .symbol = "x0",
    .lower = -1e3,
    .upper = 1e3,
    .starts = {0.25, 0.75},
    .traits = {.starts_are_shares_of_travel = true},
    .sheet = {.what = "Position at which the stiffness changes; positive: in extension.",
              .unit = "mm",
              .range = "Numerics: any position of any frame; a knee outside of the stroke changes nothing.",
              .errors = "An offset of the position shifts it by as much. Undetermined outside of the stroke. Mistaken "
                        "for the end of a slack."}};
const Coefficient kKneeStiffness{
    .name = "stiffness_N_mm",
    .symbol = "k",
    .sign = Sign::kFree,
    .sheet = {.what = "Stiffness that is added beyond the knee; positive: stiffer in extension.",
              .unit = "N/mm",
              .range = "Physics: fibres may take up load or buckle beyond the knee, so it has no sign.",
              .errors =
                  "A stroke that hardly passes the knee cannot separate it from the position. Mistaken for a slip when "
                  "the motion is one-way."}};

}  // namespace

const Physics& strain_stiffening() {
  static const Physics physics{
      "strain_stiffening",
      Stage::kSpecimen,
      "Elastic force that is nonlinear in strain.",
      "Tondu 2012 (McKibben: stiffness grows with length); Fung 1967 (exponential). Fibres of "
      "spread slack lengths (Decraemer 1980). A braid locks (Chou & Hannaford 1996); its force grows as near any limit "
      "of extension (Gent 1996). A rubber is stiff, soft and stiff again (Ogden 1972): no knee, but a curve of few "
      "powers. Linear and constant parts "
      "belong to the spring and the tare, so the position may be counted from anywhere.",
      "Slow triangle of the largest amplitude: the loading line is curved, the same at every velocity. "
      "Mistaken "
      "for a load cell that is not linear, which curves the relaxing part too.",
      {{"quadratic",
        "F = k2 x^2",
        {},
        {kQuadratic},
        [](auto, const Reference&) { return std::make_unique<Powers>(2, 2); }},
       {"cubic", "F = k3 x^3", {}, {kCubic}, [](auto, const Reference&) { return std::make_unique<Powers>(3, 3); }},
       {"polynomial",
        "F = k2 x^2 + k3 x^3",
        {},
        {kQuadratic, kCubic},
        [](auto, const Reference&) { return std::make_unique<Powers>(2, 3); }},
       {"quintic",
        "F = k2 x^2 + k3 x^3 + k4 x^4 + k5 x^5",
        {},
        {kQuadratic, kCubic, kQuartic, kQuintic},
        [](auto, const Reference&) { return std::make_unique<Powers>(2, 5); }},
       {"exponential",
        "F = k L (exp(x / L) - 1 - x / L)",
        {{.name = "length_mm",
          .symbol = "L",
          .lower = 0.1,
          .upper = 100.0,
          .starts = {3.0},
          .logarithmic = true,
          .sheet =
              {.what = "Length over which the stiffness grows by a factor e.",
               .unit = "mm",
               .range = "Numerics: at 0.1 mm the force grows by exp(50) over the rig's 5 mm; at 100 mm the curve "
                        "is a parabola within 2 % over 5 mm.",
               .errors =
                   "A stroke that is short against it cannot separate it from the stiffness. Mistaken for a knee."}}},
        {{.name = "stiffness_N_mm",
          .symbol = "k",
          .sign = Sign::kNonNegative,
          .sheet = {.what = "Stiffness that is added at 0.69 lengths of extension; at x, k (exp(x / L) - 1).",
                    .unit = "N/mm",
                    .range = "Physics: fibres that straighten pull more, so it is not negative; no upper bound.",
                    .errors =
                        "Tied to the length where the stroke is short. Mistaken for the curvature of a load cell."}}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Exponential>(p[0]); }},
       {"knee",
        "F = k max(0, x - x0)",
        {kKneePosition},
        {kKneeStiffness},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Knee>(p[0]); }},
       {"smooth_knee",
        "F = k w ln(1 + exp((x - x0) / w))",
        {kKneePosition,
         {.name = "width_mm",
          .symbol = "w",
          .lower = 0.02,
          .upper = 20.0,
          .starts = {0.3, 0.3},
          .logarithmic = true,
          .sheet =
              {.what = "Spread of the lengths at which the fibres begin to pull; the knee bends over four times that.",
               .unit = "mm",
               .range =
                   "Instrument: 20 um cannot be told from a sharp knee; 20 mm, twice the rig's travel, is a parabola.",
               .errors = "A stroke that does not pass the knee cannot separate it from the position. Mistaken for the "
                         "exponential law."}}},
        {kKneeStiffness},
        [](std::span<const double> p, const Reference&) { return std::make_unique<SmoothKnee>(p[0], p[1]); }},
       {"lock",
        "F = k L u^2 / (1 - u), u = x / L",
        {{.name = "lock_mm",
          .symbol = "L",
          .lower = 0.5,
          .upper = 1e3,
          .starts = {8.0, 60.0},
          .logarithmic = true,
          .sheet = {.what = "Position at which the braid locks and the specimen lengthens no further.",
                    .unit = "mm",
                    .range =
                        "Physics: what was passed was not the lock, so it lies beyond the largest position; beyond "
                        "1 m the law is a parabola in any stroke.",
                    .errors =
                        "A stroke that stays below half of it cannot separate it from the stiffness. Mistaken for the "
                        "exponential law."}}},
        {{.name = "stiffness_N_mm",
          .symbol = "k",
          .sign = Sign::kNonNegative,
          .sheet = {.what = "Size of the stiffening: in small extension the force is this times x^2 / L.",
                    .unit = "N/mm",
                    .range = "Physics: a lock resists extension, so it is not negative; no upper bound.",
                    .errors =
                        "A stroke far from the lock cannot separate it from the position of the lock. Mistaken for the "
                        "quadratic term."}}},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Lock>(p[0]); }}},
      {.acts_on = "elastic branch",
       .depends_on = {"strain"},
       .shape_of = ShapeOf::kPosition,
       .words = "stiffening with strain"}};
  return physics;
}

}  // namespace isorig::model::effect
