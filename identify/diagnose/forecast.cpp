#include "identify/diagnose/forecast.hpp"

#include <algorithm>

#include "model/catalogue.hpp"

namespace isorig::identify {

std::vector<double> lower_triangle(const Eigen::MatrixXd& matrix) {
  std::vector<double> out;
  for (Eigen::Index i = 0; i < matrix.rows(); ++i)
    for (Eigen::Index j = 0; j <= i; ++j) out.push_back(matrix(i, j));
  return out;
}

std::vector<UnreadPressure> unread_by(const model::ModelSpec& spec, const messages::Recording& recording) {
  const bool reads = std::ranges::any_of(spec.parts, [](const model::Part& part) {
    const model::PressureNeed need = part.physics->traits.pressure;
    return need == model::PressureNeed::kMeasured || need == model::PressureNeed::kVaries ||
           part.physics->traits.driven_by_pressure || (part.law->make_table && part.law->name == "pressure");
  });
  if (!reads || recording.frame.t_s.empty()) return {};
  if (!recording.pressure) return {{recording.frame.t_s.front(), recording.frame.t_s.back()}};
  return unread_pressure(recording);
}

Forecast forecast(const model::ModelSpec& spec, const Excitation& excitation,
                  const std::function<void(double fraction)>& on_progress, const std::vector<UnreadPressure>& unread) {
  Forecast out;
  RunningForecast running(spec, excitation.reference, noise_of(excitation));
  running.reset(excitation.instants.front());
  for (model::Instant now : excitation.instants) {
    if (!out.force_N.empty() && out.force_N.size() == excitation.begin_row) {
      now.dt_s = now.step_mm = now.slide_mm = 0.0;
      running.reset(now);
    }
    const auto row = running.step(now, std::ranges::any_of(unread, [&](const UnreadPressure& each) {
                                    return now.t_s >= each.from_s && now.t_s <= each.to_s;
                                  }));
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
  if (!unread.empty())
    out.notes.push_back("pressure.csv has no readings from " + in_words(unread) +
                        (spec.seen ? "; the model reads the pressure, and there the prediction is the nominal model's"
                                   : "; the model reads the pressure, and there its force is not to be believed"));
  return out;
}

}  // namespace isorig::identify
