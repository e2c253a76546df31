#include <cmath>

#include "model/elements.hpp"

namespace isorig::model::element {
namespace {

enum class Of { kPosition, kRate, kTravel, kPressure, kTime, kExtending, kShortening };

/// Force by table. Extending and shortening are the direction of the last motion, kept in a hold.
class TableForce : public Process {
 public:
  TableForce(const Table& table, Of of) : table_(table), of_(of) {}
  void reset(const Instant& first) noexcept override {
    travelled_mm_ = 0.0;
    direction_ = 0.0;
    start_s_ = first.t_s;
  }
  void force(const Instant& now, double* columns) noexcept override {
    travelled_mm_ += std::fabs(now.step_mm);
    if (now.slide_mm != 0.0) direction_ = now.slide_mm;
    columns[0] = value(now);
  }

 private:
  [[nodiscard]] double value(const Instant& now) const noexcept {
    switch (of_) {
      case Of::kPosition:
        return table_.at(now.position_mm);
      case Of::kRate:
        return table_.at(squeeze(now.velocity_mm_s));
      case Of::kTravel:
        return table_.at(travelled_mm_);
      case Of::kPressure:
        return table_.at(now.excess_pressure_psi);
      case Of::kTime:
        return table_.at(now.t_s - start_s_);
      case Of::kExtending:
        return direction_ > 0.0 ? table_.at(now.position_mm) : 0.0;
      case Of::kShortening:
        return direction_ < 0.0 ? table_.at(now.position_mm) : 0.0;
    }
    return 0.0;
  }
  static double squeeze(double v) noexcept { return std::asinh(v / 0.01); }

  Table table_;
  Of of_;
  double travelled_mm_ = 0.0;
  double direction_ = 0.0;
  double start_s_ = 0.0;
};

/// Position error by table: the specimen sees x + e(x).
class TableMotion : public Process {
 public:
  explicit TableMotion(const Table& table) : table_(table) {}
  void reset(const Instant& first) noexcept override { error_mm_ = table_.at(first.position_mm); }
  void move(Instant& now) noexcept override {
    const double error = table_.at(now.position_mm);
    const double change = now.dt_s > 0.0 ? error - error_mm_ : 0.0;
    error_mm_ = error;
    now.position_mm += error;
    now.elongation_mm += error;
    now.step_mm += change;
    now.slide_mm += change;
    if (now.dt_s > 0.0) now.velocity_mm_s += change / now.dt_s;
  }

 private:
  Table table_;
  double error_mm_ = 0.0;
};

Law table_law(std::string_view name, std::string_view formula, Of of) {
  LawTraits traits;
  if (of == Of::kTime) traits.counts = Counts::kTime;
  if (of == Of::kTravel) traits.counts = Counts::kTravel;
  return {name,
          formula,
          {},
          {{.name = "scale", .sign = Sign::kFree}},
          {},
          traits,
          [of](const Table& table, const Reference&) { return std::make_unique<TableForce>(table, of); }};
}

}  // namespace

const Physics& empirical_force() {
  static const Physics physics{"empirical_force",
                               Stage::kSpecimen,
                               "A force without a law yet, by table of the one variable that carries it.",
                               "The recording it was fitted to.",
                               "What varies that variable alone.",
                               {table_law("position", "F = table(x)", Of::kPosition),
                                table_law("rate", "F = table(asinh(v / 0.01 mm/s))", Of::kRate),
                                table_law("travel", "F = table(travelled)", Of::kTravel),
                                table_law("pressure", "F = table(p - p0)", Of::kPressure),
                                table_law("time", "F = table(t since the start)", Of::kTime),
                                table_law("extending", "F = table(x) while or after extending", Of::kExtending),
                                table_law("shortening", "F = table(x) while or after shortening", Of::kShortening)}};
  return physics;
}

const Physics& empirical_motion() {
  static const Physics physics{
      "empirical_motion",
      Stage::kKinematics,
      "A position error without a law yet, by table of the position: lead error of a screw, a bent guide.",
      "The recording it was fitted to.",
      "A slow triangle against a second position sensor.",
      {{"position", "x' = x + table(x)", {}, {}, {}, {}, [](const Table& table, const Reference&) {
          return std::make_unique<TableMotion>(table);
        }}}};
  return physics;
}

}  // namespace isorig::model::element
