// The two fits of `isorig fv`, timed alone, on data that are written for the peers in bench/peers as well. A curve is
// fitted from the peers' one start, then as `isorig fv` does: from five, with profile-likelihood intervals. Usage:
// bench_fits points FOLDER   48 force-velocity curves (12 specimens x 4 pressures): what each fit costs
//        bench_fits series FOLDER   400 000 samples of two standard linear solids: from this room's start and 12 others
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "bench/series_case.hpp"
#include "identify/fv/fv_fit.hpp"
#include "identify/fv/fv_problem.hpp"
#include "identify/fv/series_fit.hpp"
#include "model/force_velocity.hpp"

namespace {

using namespace isorig::identify;
using Clock = std::chrono::steady_clock;

double ms_since(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

void write_doubles(const std::filesystem::path& path, const std::vector<double>& values) {
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(double)));
  if (!out) throw std::runtime_error(path.string() + " cannot be written");
}

/// Ten velocities as in the paper (+-2 to +-10 mm/s on 80 mm), scatter 0.5 % of the force before the ramp.
std::vector<std::vector<FvPoint>> curves() {
  std::mt19937 random(20261123);
  std::uniform_real_distribution<double> unit;
  std::normal_distribution<double> normal;
  std::vector<std::vector<FvPoint>> all(48);
  for (auto& curve : all) {
    const isorig::model::FvElement element{0.3 + 0.7 * unit(random), 0.1 + 0.4 * unit(random), 1.0};
    const isorig::model::FvTest test{0.025, 0.06 + 0.1 * unit(random)};
    for (int step = -5; step <= 5; ++step) {
      if (step == 0) continue;
      const double rate_per_s = 2.0 * step / 80.0;
      const double force = isorig::model::force_velocity({&element, 1}, test, rate_per_s) + 0.005 * normal(random);
      curve.push_back({rate_per_s, force, 0.005, test.initial_strain, test.strain_step});
    }
  }
  return all;
}

void fit_points(const std::filesystem::path& folder) {
  const auto all = curves();
  std::vector<double> table;  // rows: curve, rate, force, initial strain, strain step
  for (std::size_t i = 0; i < all.size(); ++i)
    for (const FvPoint& p : all[i])
      table.insert(table.end(),
                   {static_cast<double>(i), p.strain_rate_per_s, p.normalized_force, p.initial_strain, p.strain_step});
  write_doubles(folder / "points.f64", table);
  std::vector<double> sums;
  for (int repetition = 0; repetition < 9; ++repetition) {
    sums.clear();
    auto begin = Clock::now();
    for (const auto& curve : all) {
      const FvProblem problem(curve, std::nullopt);
      std::array<double, 3> logarithms{std::log(0.5), std::log(0.2), 0.0};  // the peers' start
      sums.push_back(problem.solve(logarithms));
    }
    const double alone_ms = ms_since(begin);
    begin = Clock::now();
    std::size_t refused = 0;
    for (const auto& curve : all) refused += fit_control(curve).fit ? 0 : 1;
    std::printf("{\"ms\": %.4g, \"with_intervals_ms\": %.4g, \"refused\": %zu}\n", alone_ms, ms_since(begin), refused);
  }
  write_doubles(folder / "points.sums.f64", sums);
}

void fit_series_case(const std::filesystem::path& folder) {
  std::mt19937 random(2);
  const auto [t_s, x_mm, force_N] = isorig::bench::series_case(400'000, 0.05, random);
  std::uniform_real_distribution<double> even;
  write_doubles(folder / "series.t.f64", t_s);
  write_doubles(folder / "series.x.f64", x_mm);
  write_doubles(folder / "series.F.f64", force_N);
  for (int start = 0; start <= 12; ++start) {
    SeriesOptions options;
    if (start > 0)
      options.start_gamma_per_s = {1.0 / std::pow(20.0, even(random)), 1.0 / (0.05 * std::pow(20.0, even(random)))};
    const auto begin = Clock::now();
    const SeriesFit fit = fit_series(t_s, x_mm, force_N, 2, options);
    std::printf(
        "{\"own_start\": %s, \"ms\": %.4g, \"gamma_per_s\": [%.6g, %.6g], \"rms_N\": %.9g, \"stop\": \"%s\", "
        "\"passes\": %d}\n",
        start > 0 ? "false" : "true", ms_since(begin), fit.arms[0].gamma_per_s.value, fit.arms[1].gamma_per_s.value,
        fit.rms_N, std::string(name_of(fit.stop)).c_str(), fit.evaluations);
  }
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 3) {
    std::fprintf(stderr, "usage: %s points|series FOLDER\n", argv[0]);
    return 2;
  }
  std::filesystem::create_directories(argv[2]);
  if (std::strcmp(argv[1], "points") == 0) {
    fit_points(argv[2]);
  } else if (std::strcmp(argv[1], "series") == 0) {
    fit_series_case(argv[2]);
  } else {
    std::fprintf(stderr, "%s: '%s' is neither points nor series\n", argv[0], argv[1]);
    return 2;
  }
  return 0;
} catch (const std::exception& e) {
  std::fprintf(stderr, "%s\n", e.what());
  return 1;
}
