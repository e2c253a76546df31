#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>
#include <stdexcept>

#include "identify/diagnose/diagnosis.hpp"

/// Numbers at the edge of what the readers take (messages/csv.hpp), through the whole diagnosis: refused as an error,
/// or judged with finite numbers. Forces of 1e300 N were "consistent, rms -nan", exit code 0.
namespace isorig::identify {
namespace {

messages::Recording session(unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise(0.0, 0.01);
  messages::Recording r;
  r.metadata.specimen = "numbers";
  r.metadata.rest_length_mm = 100.0;
  r.metadata.nominal_pressure_psi = 10.0;
  double x_mm = 0.0, arm_N = 0.0, t_s = 0.0;
  const auto go = [&](double to_mm, double duration_s) {
    const int rows = static_cast<int>(duration_s / 0.05);
    const double step_mm = (to_mm - x_mm) / rows;
    for (int i = 0; i < rows; ++i) {
      arm_N = arm_N * std::exp(-0.05 / 2.0) + 1.5 * step_mm;
      x_mm += step_mm;
      r.frame.t_s.push_back(t_s += 0.05);
      r.frame.position_mm.push_back(x_mm);
      r.frame.force_N.push_back(40.0 + 2.5 * x_mm + arm_N + noise(random));
    }
  };
  go(0.0, 6.0);
  for (const double speed : {1.0, 4.0}) {
    for (const double to : {2.0, -2.0}) {
      go(to, 2.0 / speed);
      go(to, 6.0);
      go(0.0, 4.0);
      go(0.0, 6.0);
    }
  }
  return r;
}

bool finite(const Diagnosis& d) {
  return std::isfinite(d.noise_N) && std::isfinite(d.nominal_errors.train_rmse_N) &&
         std::isfinite(d.model_errors.train_rmse_N);
}

TEST(Numbers, AtTheEdgeOfTheRangeAreJudgedInFiniteNumbersOrRefused) {
  const std::pair<const char*, std::function<void(messages::FrameSamples&)>> cases[] = {
      {"one force of 1e6", [](auto& f) { f.force_N[f.size() / 2] = 1e6; }},
      {"all forces near 1e6",
       [](auto& f) {
         for (double& v : f.force_N) v += 9e5;
       }},
      {"forces of 1e-300",
       [](auto& f) {
         for (double& v : f.force_N) v *= 1e-300;
       }},
      {"forces of 1e-160",
       [](auto& f) {
         for (double& v : f.force_N) v *= 1e-160;
       }},
      {"no force at all",
       [](auto& f) {
         for (double& v : f.force_N) v = 0.0;
       }},
      {"one position of 1e4", [](auto& f) { f.position_mm[f.size() / 3] = 1e4; }},
      {"a step of a nanosecond", [](auto& f) { f.t_s[100] = f.t_s[99] + 1e-9; }},
      {"a gap of a day",
       [](auto& f) {
         for (std::size_t k = f.size() / 2; k < f.size(); ++k) f.t_s[k] += 9.9e4;
       }},
      {"all beyond the readers' range",
       [](auto& f) {
         for (double& v : f.force_N) v *= 1e300;
       }},
      {"overflow in a square", [](auto& f) { f.force_N[10] = -1e200; }},
  };
  for (const auto& [name, put] : cases) {
    SCOPED_TRACE(name);
    auto r = session(3);
    put(r.frame);
    try {
      const Study study = diagnose({r}, {"r"}, model::nominal_model("slse1"), {});
      EXPECT_TRUE(finite(study.diagnosis));
    } catch (const std::invalid_argument&) {
    } catch (const std::domain_error&) {
    }
  }
}

}  // namespace
}  // namespace isorig::identify
