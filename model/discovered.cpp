#include "model/discovered.hpp"

#include <array>
#include <cmath>
#include <deque>
#include <stdexcept>
#include <string>

#include "model/effects/presliding.hpp"
#include "model/elements.hpp"

namespace isorig::model::element {
namespace {

/// What pulls: a state of the specimen that a force is in proportion to.
enum class Carrier { kElastic, kArm, kDashpot, kFriction };
/// What the proportion changes with.
enum class Modulator { kNothing, kPosition, kPositionSquared, kMagnitude, kRate, kPressure, kTravel, kFarthest };

/// Powers of the units that a factor has.
struct Units {
  int mm = 0, s = 0, psi = 0;
};

struct CarrierWords {
  Carrier carrier;
  std::string_view name, symbol, state;
  std::string_view acts_on, depends_on, force;
  Units units;
};
constexpr std::array kCarriers{
    CarrierWords{Carrier::kElastic,
                 "elastic",
                 "e",
                 "e the elongation",
                 "elastic branch",
                 "strain",
                 "the elastic force",
                 {.mm = 1}},
    CarrierWords{Carrier::kArm, "arm", "z", "dz/dt = v - z / ta", "arm", "arm state", "the force of an arm", {.mm = 1}},
    CarrierWords{Carrier::kDashpot,
                 "dashpot",
                 "v",
                 "v the velocity",
                 "dashpot",
                 "rate",
                 "the viscous force",
                 {.mm = 1, .s = -1}},
    CarrierWords{Carrier::kFriction,
                 "friction",
                 "s",
                 "ds/dx = (1 - s sign(dx)) / d",
                 "friction element",
                 "direction",
                 "friction",
                 {}},
};

struct ModulatorWords {
  Modulator modulator;
  std::string_view name, symbol;
  std::string_view depends_on, by;
  Units units;
};
constexpr std::array kModulators{
    ModulatorWords{Modulator::kNothing, "alone", "", "", "", {}},
    ModulatorWords{Modulator::kPosition, "position", "x", "strain", "the position", {.mm = 1}},
    ModulatorWords{
        Modulator::kPositionSquared, "position_squared", "x^2", "strain", "the square of the position", {.mm = 2}},
    ModulatorWords{Modulator::kMagnitude, "magnitude", "", "", "its own size", {}},
    ModulatorWords{Modulator::kRate, "rate", "|v|", "rate", "the speed", {.mm = 1, .s = -1}},
    ModulatorWords{Modulator::kPressure, "pressure", "(p - p0)", "pressure", "the pressure", {.psi = 1}},
    ModulatorWords{Modulator::kTravel, "travel", "travelled", "travel", "the distance travelled", {.mm = 1}},
    ModulatorWords{
        Modulator::kFarthest, "farthest", "farthest", "largest strain", "the farthest position so far", {.mm = 1}},
};

/// Products that are in another place: an elastic force alone is the nominal spring; the size of a bristle is one.
constexpr bool is_term(Carrier carrier, Modulator modulator) {
  if (carrier == Carrier::kElastic) return modulator != Modulator::kNothing && modulator != Modulator::kMagnitude;
  return carrier != Carrier::kFriction || modulator != Modulator::kMagnitude;
}

/// One product; its column is that of a coefficient of one.
class Product : public Process {
 public:
  Product(Carrier carrier, Modulator modulator, double number) noexcept
      : carrier_(carrier), modulator_(modulator), arm_(number), bristle_(number) {}
  void reset(const Instant& first) noexcept override {
    arm_.reset();
    bristle_.reset();
    first_mm_ = first.position_mm;
    travelled_mm_ = farthest_mm_ = 0.0;
  }
  void force(const Instant& now, double* columns) noexcept override {
    travelled_mm_ += std::fabs(now.step_mm);
    farthest_mm_ = std::fmax(farthest_mm_, std::fabs(now.position_mm - first_mm_));
    const double carried = state(now);
    columns[0] = carried * factor(now, carried);
  }

 private:
  [[nodiscard]] double state(const Instant& now) noexcept {
    switch (carrier_) {
      case Carrier::kElastic:
        return now.elongation_mm;
      case Carrier::kArm:
        return arm_.step(now.step_mm, now.dt_s);
      case Carrier::kDashpot:
        return now.velocity_mm_s;
      case Carrier::kFriction:
        return bristle_.slide(std::isnan(now.slide_mm) ? now.step_mm : now.slide_mm);
    }
    return 0.0;
  }
  [[nodiscard]] double factor(const Instant& now, double carried) const noexcept {
    switch (modulator_) {
      case Modulator::kNothing:
        return 1.0;
      case Modulator::kPosition:
        return now.position_mm;
      case Modulator::kPositionSquared:
        return now.position_mm * now.position_mm;
      case Modulator::kMagnitude:
        return std::fabs(carried);
      case Modulator::kRate:
        return std::fabs(now.velocity_mm_s);
      case Modulator::kPressure:
        return now.excess_pressure_psi;
      case Modulator::kTravel:
        return travelled_mm_;
      case Modulator::kFarthest:
        return farthest_mm_;
    }
    return 0.0;
  }

  Carrier carrier_;
  Modulator modulator_;
  MaxwellState arm_;
  effect::DahlBristle bristle_;
  double first_mm_ = 0.0, travelled_mm_ = 0.0, farthest_mm_ = 0.0;
};

/// "N s/mm2" and, as it stands in a name, "N_s_mm2".
std::string unit_of(const Units& factor, bool for_name) {
  std::string unit = "N";
  const auto add = [&](const char* before, int power, const char* of) {
    if (power > 0) unit += std::string(for_name ? "_" : before) + of + (power > 1 ? std::to_string(power) : "");
  };
  add(" ", -factor.s, "s");
  add("/", factor.mm, "mm");
  add("/", factor.psi, "psi");
  return unit;
}

std::vector<Parameter> parameters_of(Carrier carrier) {
  if (carrier == Carrier::kArm)
    return {{.name = "arm_s",
             .symbol = "ta",
             .lower = 0.01,
             .upper = 1e4,
             .starts = {0.1, 0.4, 1.5, 6.0, 25.0, 100.0},
             .logarithmic = true,
             .sheet = {.what = "Time in which the arm's force falls to 1/e in a hold.",
                       .unit = "s",
                       .range = "Numerics: 10 ms to three hours, what a recording of this rig can resolve.",
                       .errors = "Undetermined where no hold or change of velocity lasts about as long."}}};
  if (carrier == Carrier::kFriction)
    return {{.name = "presliding_mm",
             .symbol = "d",
             .lower = 2e-4,
             .upper = 1.0,
             .starts = {0.02, 0.1, 0.4},
             .logarithmic = true,
             .sheet = effect::kPreslidingSheet}};
  return {};
}

/// Names and formulas are made once and kept: laws refer to them.
std::string_view kept(std::string text) {
  static std::deque<std::string> texts;
  return texts.emplace_back(std::move(text));
}

std::string symbol_of(const CarrierWords& carrier, const ModulatorWords& modulator) {
  return modulator.modulator == Modulator::kMagnitude ? "|" + std::string(carrier.symbol) + "|"
                                                      : std::string(modulator.symbol);
}

Law law_of(const CarrierWords& carrier, const ModulatorWords& modulator) {
  Units units = carrier.units;
  const Units more = modulator.modulator == Modulator::kMagnitude ? carrier.units : modulator.units;
  units.mm += more.mm;
  units.s += more.s;
  units.psi += more.psi;
  const std::string symbol = symbol_of(carrier, modulator);
  LawTraits traits;
  if (modulator.modulator == Modulator::kTravel) traits.counts = Counts::kTravel;
  if (modulator.modulator == Modulator::kFarthest) traits.counts = Counts::kLargestStrain;
  const Carrier of = carrier.carrier;
  const Modulator by = modulator.modulator;
  return {kept(std::string(carrier.name) + "_" + std::string(modulator.name)),
          kept("F = c " + std::string(carrier.symbol) + (symbol.empty() ? "" : " ") + symbol + ", " +
               std::string(carrier.state)),
          parameters_of(of),
          {{.name = kept("c_" + unit_of(units, true)),
            .symbol = "c",
            .sign = Sign::kFree,
            .sheet = {.what = "Force for each unit of the product.",
                      .unit = kept(unit_of(units, false)),
                      .range = "Physics: either sign, as long as the whole model gives out no work on a closed loop.",
                      .errors = "Products that go alike in the recording share it."}}},
          [of, by](std::span<const double> p, const Reference&) {
            return std::make_unique<Product>(of, by, p.empty() ? 1.0 : p[0]);
          },
          traits};
}

std::vector<Law> all_laws() {
  std::vector<Law> laws;
  for (const auto& carrier : kCarriers)
    for (const auto& modulator : kModulators)
      if (is_term(carrier.carrier, modulator.modulator)) laws.push_back(law_of(carrier, modulator));
  return laws;
}

}  // namespace

const Physics& discovered() {
  static const Physics physics{
      "discovered",
      Stage::kSpecimen,
      "A force that the recording asked for and that has no name: a state of the specimen times "
      "a factor.",
      "Products of the terms of sparse regression (Brunton, Proctor & Kutz 2016); arms and "
      "bristles as history operators (Flaschel, Kumar & De Lorenzis 2023).",
      "What varies the factor while the state repeats.",
      all_laws()};
  return physics;
}

}  // namespace isorig::model::element

namespace isorig::model {

ProductWords product_words(std::string_view law) {
  using namespace element;
  for (const auto& carrier : kCarriers) {
    for (const auto& modulator : kModulators) {
      if (law != std::string(carrier.name) + "_" + std::string(modulator.name)) continue;
      ProductWords out{carrier.name,
                       modulator.name,
                       carrier.acts_on,
                       {carrier.depends_on},
                       std::string(carrier.force),
                       std::string(modulator.by),
                       symbol_of(carrier, modulator)};
      if (!modulator.depends_on.empty() && modulator.depends_on != carrier.depends_on)
        out.depends_on.push_back(modulator.depends_on);
      return out;
    }
  }
  throw std::out_of_range("no product is called " + std::string(law));
}

}  // namespace isorig::model
