#include <cmath>

#include "model/effects/effects.hpp"

namespace isorig::model::effect {
namespace {

class Unsettled : public Process {
 public:
  /// `start_s` NaN: the first instant.
  Unsettled(double time_constant_s, double start_s, bool here) noexcept
      : tau_s_(time_constant_s), given_start_s_(start_s), here_(here) {}
  void reset(const Instant& first) noexcept override {
    start_s_ = std::isnan(given_start_s_) ? first.t_s : given_start_s_;
  }
  void force(const Instant& now, double* columns) noexcept override {
    columns[0] = here_ && now.t_s >= start_s_ ? std::exp(-(now.t_s - start_s_) / tau_s_) : 0.0;
  }

 private:
  double tau_s_;
  double given_start_s_;
  bool here_;
  double start_s_ = 0.0;
};

}  // namespace

const Physics& unsettled_start() {
  static const Physics physics{
      "unsettled_start",
      Stage::kSpecimen,
      "The recording starts before the specimen has come to rest.",
      "Maxwell arm with force left in it.",
      "Wait longer before the first motion.",
      {{"exponential",
        "F = F0 exp(-(t - t0) / tau) for t >= t0, of one recording or of all",
        {{"time_constant_s", 0.05, 100.0, {1.0, 20.0}, true},
         // What a filling leaves is of its recording, by that recording's duration, from the time the filling
         // was over. 0: every recording, from its first instant.
         {"recording_duration_s", 0.0, 1e9, {0.0}, false, true},
         {"start_s", -1e9, 1e9, {0.0}, false, true}},
        {{"force_N", Sign::kFree}},
        [](std::span<const double> p, const Reference& reference) {
          const bool every = p[1] == 0.0;
          return std::make_unique<Unsettled>(p[0], every ? std::nan("") : p[2],
                                             every || std::fabs(p[1] - reference.duration_s) < 1e-3);
        }}}};
  return physics;
}

}  // namespace isorig::model::effect
