#include "proof/foreign_laws/laws.hpp"

namespace isorig::proof::foreign {

Signal ogden_roxburgh(const Drive& drive, double share, double energy_N_mm) {
  Signal force(drive.size());
  double most_N_mm = 0.0;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const double work_N_mm = 0.5 * drive.elastic_N[i] * drive.elastic_N[i] / drive.stiffness_N_mm;
    most_N_mm = std::max(most_N_mm, work_N_mm);
    force[i] = -share * std::erf((most_N_mm - work_N_mm) / energy_N_mm) * drive.elastic_N[i];
  }
  return force;
}

Signal simo_damage(const Drive& drive, double share, double scale_mm) {
  Signal force(drive.size());
  double most_mm = 0.0;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    most_mm = std::max(most_mm, std::abs(drive.position_mm[i] - drive.position_mm[0]));
    const double x = most_mm / scale_mm;
    const double damage = x < 1e-6 ? 0.5 * x : 1.0 + std::expm1(-x) / x;
    force[i] = -share * damage * drive.elastic_N[i];
  }
  return force;
}

Signal miehe_damage(const Drive& drive, double share, double energy_N_mm) {
  Signal force(drive.size());
  double turned_over_N_mm = 0.0;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    if (i > 0) {
      const double move_mm = drive.position_mm[i] - drive.position_mm[i - 1];
      turned_over_N_mm += std::abs(0.5 * (drive.elastic_N[i] + drive.elastic_N[i - 1]) * move_mm);
    }
    force[i] = share * std::expm1(-turned_over_N_mm / energy_N_mm) * drive.elastic_N[i];
  }
  return force;
}

}  // namespace isorig::proof::foreign
