#include <array>
#include <cmath>

#include "model/effects/bouc_wen.hpp"
#include "model/effects/effects.hpp"
#include "model/effects/presliding.hpp"
#include "model/stepping.hpp"

namespace isorig::model::effect {
namespace {

class Dahl : public Process {
 public:
  explicit Dahl(double presliding_mm) noexcept : bristle_(presliding_mm) {}
  void reset(const Instant&) noexcept override { bristle_.reset(); }
  void force(const Instant& now, double* columns) noexcept override { columns[0] = bristle_.slide(now.slide_mm); }

 private:
  DahlBristle bristle_;
};

/// LuGre without its bristle damping: as Dahl, but the bristle slips at g(v) = 1 + r exp(-(|v| / vs)^n). It
/// keeps its force in a hold, whatever the velocity before it was. Exact at constant velocity.
class Stribeck : public Process {
 public:
  Stribeck(double presliding_mm, double velocity_mm_s, double excess, bool square) noexcept
      : presliding_mm_(presliding_mm), velocity_mm_s_(velocity_mm_s), excess_(excess), square_(square) {}
  void reset(const Instant&) noexcept override { z_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    const double s = sign_of(now.slide_mm);
    if (s != 0.0 && now.dt_s > 0.0) {
      const double u = std::fabs(now.slide_mm) / now.dt_s / velocity_mm_s_;
      const double limit = 1.0 + excess_ * std::exp(square_ ? -u * u : -u);
      z_ = s * limit + (z_ - s * limit) * std::exp(-std::fabs(now.slide_mm) / (presliding_mm_ * limit));
    }
    columns[0] = z_;
  }

 private:
  double presliding_mm_;
  double velocity_mm_s_;
  double excess_;
  bool square_;
  double z_ = 0.0;
};

/// Jenkins: a spring that slips at once when its force reaches the limit. Exact on monotone steps.
class Jenkins : public Process {
 public:
  explicit Jenkins(double presliding_mm) noexcept : presliding_mm_(presliding_mm) {}
  void reset(const Instant&) noexcept override { z_ = 0.0; }
  void force(const Instant& now, double* columns) noexcept override {
    z_ = std::clamp(z_ + now.slide_mm / presliding_mm_, -1.0, 1.0);
    columns[0] = z_;
  }

 private:
  double presliding_mm_;
  double z_ = 0.0;
};

/// Many Jenkins elements whose slip distances are spread evenly (Iwan): the presliding curve is a parabola.
class Iwan : public Process {
 public:
  explicit Iwan(double presliding_mm) noexcept : presliding_mm_(presliding_mm) {}
  void reset(const Instant&) noexcept override { z_.fill(0.0); }
  void force(const Instant& now, double* columns) noexcept override {
    double sum = 0.0;
    for (std::size_t i = 0; i < kCount; ++i) {
      const double distance = presliding_mm_ * (static_cast<double>(i) + 0.5) / kCount;
      z_[i] = std::clamp(z_[i] + now.slide_mm / distance, -1.0, 1.0);
      sum += z_[i];
    }
    columns[0] = sum / kCount;
  }

 private:
  static constexpr std::size_t kCount = 8;
  double presliding_mm_;
  std::array<double, kCount> z_{};
};

/// Iwan's elements with a force that drops at once as the velocity rises and recovers at once at rest, as with a film
/// between the surfaces. (In the Stribeck laws the bristle keeps in a hold the deflection of the last velocity.) Not
/// passive within presliding: deflected fast and released slowly, it returns up to a share `excess` more work than it
/// took.
class WeakenedIwan : public Iwan {
 public:
  WeakenedIwan(double presliding_mm, double velocity_mm_s, double excess) noexcept
      : Iwan(presliding_mm), velocity_mm_s_(velocity_mm_s), excess_(excess) {}
  void force(const Instant& now, double* columns) noexcept override {
    Iwan::force(now, columns);
    columns[0] *= 1.0 + excess_ * std::exp(-std::fabs(now.velocity_mm_s) / velocity_mm_s_);
  }

 private:
  double velocity_mm_s_;
  double excess_;
};

class BoucWen : public Process {
 public:
  BoucWen(double presliding_mm, double exponent, double beta_share) noexcept
      : bristle_(presliding_mm, exponent, beta_share) {}
  void reset(const Instant&) noexcept override { bristle_.reset(); }
  void force(const Instant& now, double* columns) noexcept override { columns[0] = bristle_.slide(now.slide_mm); }

 private:
  BoucWenBristle bristle_;
};

/// sign(v) made smooth over a small velocity: no memory, so nothing is left of it in a hold.
class Regularised : public Process {
 public:
  explicit Regularised(double velocity_mm_s) noexcept : velocity_mm_s_(velocity_mm_s) {}
  void reset(const Instant&) noexcept override {}
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = std::tanh(now.velocity_mm_s / velocity_mm_s_);
  }

 private:
  double velocity_mm_s_;
};

const Parameter kPresliding = presliding({0.02, 0.2});
const Parameter kStribeckVelocity{.name = "stribeck_velocity_mm_s",
                                  .symbol = "vs",
                                  .lower = 0.02,
                                  .upper = 50.0,
                                  .starts = {2.0, 0.3},
                                  .logarithmic = true,
                                  .sheet = {.what = "Sliding speed at which the static excess has fallen to 1/e.",
                                            .unit = "mm/s",
                                            .range = "Instrument: the frame moves at 0.005 to 10 mm/s; below 0.02 "
                                                     "hardly a speed shows the excess, above 50 none shows it gone.",
                                            .errors = "Too few speeds leave it undetermined. Mistaken for a time "
                                                      "constant when acceleration and speed change together."}};
const Parameter kStaticExcess{
    .name = "static_excess",
    .symbol = "r",
    .lower = 0.0,
    .upper = 4.0,
    .starts = {0.3},
    .sheet = {
        .what = "How much more friction there is near standstill than at speed, as a share of the sliding friction.",
        .unit = "1",
        .range = "Physics: friction weakens with speed, so it is not negative; 4 means that breaking away takes five "
                 "times the sliding friction, beyond what dry or greased contacts show.",
        .errors = "A presliding distance that is too short exaggerates it. Mistaken for a fast relaxation right after "
                  "each reversal."}};
const Parameter kBoucWenPresliding = presliding({0.05});
const Parameter kBoucWenExponent{
    .name = "exponent",
    .symbol = "n",
    .lower = 1.0,
    .upper = 10.0,
    .starts = {2.0},
    .logarithmic = true,
    .traits = {.lower_limit_law = "a bristle that bends as Dahl's", .upper_limit_law = "a spring that slips at once"},
    .sheet = {.what = "How sharply the presliding turns into sliding: 1 bends from the start, 10 has a knee.",
              .unit = "1",
              .range = "Physics: below 1 the law has no unique course where the bristle is slack (Ikhouane & Rodellar "
                       "2005); Numerics: at 10 the knee is a tenth of the presliding distance wide, and a spring that "
                       "slips at once fits as well.",
              .errors = "Reversals that are all longer than the presliding distance cannot separate it from that "
                        "distance. Mistaken for a spread of slip distances (iwan)."}};
const Parameter kBetaShare{
    .name = "beta_share",
    .symbol = "sigma",
    .lower = 0.5,
    .upper = 2.0,
    .starts = {0.8},
    .logarithmic = true,
    .traits = {.lower_limit_law = "bouc_wen_equal"},
    .sheet = {
        .what = "Wen's beta over beta + gamma: an unloading begins twice that times as steep as the first loading.",
        .unit = "1",
        .range = "Physics: below 1/2 a loop gives back more work than it took (Erlicher & Point 2004); Numerics: "
                 "at 2 the unloading is four times as steep, which a shorter presliding distance does as well.",
        .errors = "Only the first half of an unloading shows it, which noise of the position hides first; what is left "
                  "then is its product with the presliding distance. Mistaken for the exponent."}};
const Coefficient kForce{
    .name = "force_N",
    .symbol = "Fc",
    .sign = Sign::kNonNegative,
    .sheet = {.what = "Friction force at steady sliding; the loop between extending and shortening is twice as high.",
              .unit = "N",
              .range = "Physics: friction dissipates, so it is not negative; no upper bound.",
              .errors = "A relaxation slower than the ramps, or play, puts part of its loop here. Mistaken for play "
                        "where the loop is seen at one stiffness only."}};

}  // namespace

const Physics& coulomb_friction() {
  static const Physics physics{
      "coulomb_friction",
      Stage::kSpecimen,
      "Rate-independent friction between mesh, bladder and sheath, with presliding.",
      "Coulomb 1785; Dahl 1968 (bristle); Jenkins 1962; Iwan 1966 (spread slip distances); Stribeck weakening as "
      "in LuGre (Canudas de Wit et al. 1995); Bouc 1967, Wen 1976, normalised and bounded as in Ikhouane & Rodellar "
      "2005, Erlicher & Point 2004 (survey: Ismail, Ikhouane & Rodellar 2009); for McKibben muscles Chou & Hannaford "
      "1996, Tondu & Lopez 2000.",
      "Slow triangles: the loop keeps its height at every velocity. Reversals of 1 to 100 um show the "
      "presliding. "
      "Mistaken for play (which scales with stiffness and delays every relaxation) and for a slow "
      "relaxation.",
      {{"dahl",
        "F = Fc z, dz/dx = (1 - z sign(dx)) / delta",
        {kPresliding},
        {kForce},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Dahl>(p[0]); }},
       {"jenkins",
        "F = Fc clamp(z), dz = dx / delta within [-1, 1]",
        {kPresliding},
        {kForce},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Jenkins>(p[0]); }},
       {"iwan",
        "F = Fc mean of Jenkins elements, distances even in (0, delta)",
        {kPresliding},
        {kForce},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Iwan>(p[0]); }},
       {"stribeck",
        "F = Fc z, dz/dx = (1 - z sign(dx) / g) / delta, g = 1 + r exp(-(v / vs)^2)",
        {kPresliding, kStribeckVelocity, kStaticExcess},
        {kForce},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Stribeck>(p[0], p[1], p[2], true); }},
       {"stribeck_exponential",
        "F = Fc z, dz/dx = (1 - z sign(dx) / g) / delta, g = 1 + r exp(-|v| / vs)",
        {kPresliding, kStribeckVelocity, kStaticExcess},
        {kForce},
        [](std::span<const double> p, const Reference&) {
          return std::make_unique<Stribeck>(p[0], p[1], p[2], false);
        }},
       {"iwan_stribeck",
        "F = Fc (1 + r exp(-|v| / vs)) mean of Jenkins elements, distances even in (0, delta)",
        {kPresliding, kStribeckVelocity, kStaticExcess},
        {kForce},
        [](std::span<const double> p, const Reference&) { return std::make_unique<WeakenedIwan>(p[0], p[1], p[2]); }},
       {"bouc_wen_equal",
        "F = Fc z, dz/dx = (1 - |z|^n (sign(z dx) + 1) / 2) / delta",
        {kBoucWenPresliding, kBoucWenExponent},
        {kForce},
        [](std::span<const double> p, const Reference&) { return std::make_unique<BoucWen>(p[0], p[1], 0.5); }},
       {"bouc_wen",
        "F = Fc z, dz/dx = (1 - |z|^n (sigma sign(z dx) + 1 - sigma)) / delta",
        {kBoucWenPresliding, kBoucWenExponent, kBetaShare},
        {kForce},
        [](std::span<const double> p, const Reference&) { return std::make_unique<BoucWen>(p[0], p[1], p[2]); }},
       {"regularised",
        "F = Fc tanh(v / v0)",
        {{.name = "velocity_mm_s",
          .symbol = "v0",
          .lower = 1e-4,
          .upper = 1e3,
          .starts = {0.002, 0.5},
          .logarithmic = true,
          .traits = {.lower_limit_law = "ideal dry friction", .upper_limit_law = "a dashpot"},
          .sheet = {.what = "Speed over which the friction turns from one sign to the other.",
                    .unit = "mm/s",
                    .range = "Numerics: far below the slowest speed of 0.005 mm/s the law is the sign of the speed; at "
                             "1000 mm/s, a hundred times the fastest, it is a linear dashpot.",
                    .errors = "The differentiated position is noisy, which widens it. Mistaken for viscous drag."}}},
        {kForce},
        [](std::span<const double> p, const Reference&) { return std::make_unique<Regularised>(p[0]); }}},
      {.acts_on = "friction element",
       .depends_on = {"direction", "rate"},
       .shape_of = ShapeOf::kRate,
       .words = "dry friction"}};
  return physics;
}

}  // namespace isorig::model::effect
