#include "identify/diagnose/forecast.hpp"

namespace isorig::identify {

std::vector<double> lower_triangle(const Eigen::MatrixXd& matrix) {
  std::vector<double> out;
  for (Eigen::Index i = 0; i < matrix.rows(); ++i)
    for (Eigen::Index j = 0; j <= i; ++j) out.push_back(matrix(i, j));
  return out;
}

Forecast forecast(const model::ModelSpec& spec, const Excitation& excitation,
                  const std::function<void(double fraction)>& on_progress) {
  Forecast out;
  RunningForecast running(spec, excitation.reference, noise_of(excitation));
  running.reset(excitation.instants.front());
  for (model::Instant now : excitation.instants) {
    if (!out.force_N.empty() && out.force_N.size() == excitation.begin_row) {
      now.dt_s = now.step_mm = now.slide_mm = 0.0;
      running.reset(now);
    }
    const auto row = running.step(now);
    out.force_N.push_back(row.force_N);
    constexpr std::size_t kBetween = 100'000;  // rows
    if (on_progress && out.force_N.size() % kBetween == 0)
      on_progress(static_cast<double>(out.force_N.size()) / static_cast<double>(excitation.instants.size()));
    if (!spec.seen) continue;
    out.low95_N.push_back(row.force_N - row.half_N);
    out.high95_N.push_back(row.force_N + row.half_N);
    out.outside.push_back(row.outside ? 1.0 : 0.0);
  }
  out.notes = running.notes();
  return out;
}

}  // namespace isorig::identify
