#include "identify/diagnose/explain/heldout.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>

#include "base/parallel.hpp"
#include "identify/diagnose/fit/left_out.hpp"
#include "identify/diagnose/fit/moves.hpp"

namespace isorig::identify {
namespace {

struct Move {
  double low_mm = 1e300, high_mm = -1e300;
  double fastest_mm_s = 0.0;
  double moving_s = 0.0, turning_s = 0.0;
  int reversals = 0;
};

/// Move of every bin, over all series.
struct Moves {
  std::vector<Move> moves;
  std::vector<std::size_t> of_bin;
};

Moves find_moves(std::span<const Series> series) {
  Moves out;
  for (const Series& each : series) {
    out.moves.emplace_back();
    double direction = 0.0;
    for (std::size_t k = 0; k < each.nodes.size(); ++k) {
      if (begins_move(each, k)) {
        out.moves.emplace_back();
        direction = 0.0;
      }
      out.of_bin.push_back(out.moves.size() - 1);
      Move& move = out.moves.back();
      const auto& node = each.nodes[k];
      move.low_mm = std::min(move.low_mm, node.position_mm);
      move.high_mm = std::max(move.high_mm, node.position_mm);
      // Over a step, not at an instant: corners overshoot.
      if (node.dt_s > 0.0 && each.since_corner_s[k] > 0.0)
        move.fastest_mm_s = std::max(move.fastest_mm_s, std::fabs(node.step_mm) / node.dt_s);
      const double least_mm = 20.0 * each.excitation.motion.noise_mm;
      if (std::fabs(node.step_mm) > 0.1 * each.excitation.motion.noise_mm) {
        move.moving_s += node.dt_s;
        if (each.since_corner_s[k] == 0.0) move.turning_s += node.dt_s;
      }
      if (std::fabs(node.step_mm) > least_mm && node.step_mm * direction < 0.0) ++move.reversals;
      if (std::fabs(node.step_mm) > least_mm) direction = node.step_mm;
    }
  }
  return out;
}

std::string text_of(double value, const char* unit) {
  char text[40];
  std::snprintf(text, sizeof text, "%.3g %s", value, unit);
  return text;
}

/// Values within a tenth of each other are one.
std::vector<std::string> grouped(const std::vector<double>& values, const char* unit) {
  std::vector<double> centres;
  std::vector<std::string> names;
  for (const double value : values) {
    if (value == 0.0) {
      names.emplace_back();
      continue;
    }
    const auto found = std::ranges::find_if(
        centres, [&](double c) { return std::fabs(value - c) <= 0.1 * std::max(std::fabs(c), 1e-6); });
    const double centre = found == centres.end() ? centres.emplace_back(value) : *found;
    names.push_back(text_of(centre, unit));
  }
  return names;
}

struct Fold {
  LeftOut what;
  model::ModelSpec model;
};

Fold leave_out(const Problem& problem, const model::ModelSpec& nominal, const model::ModelSpec& model,
               const std::vector<bool>& out_bin, LeftOut what) {
  constexpr int kIterations = 5;
  const double white_N = problem.noise().white_N;
  const Prediction without = predict_left_out(problem, nominal, out_bin, kIterations);
  Prediction with = predict_left_out(problem, model, out_bin, kIterations);
  what.readings = with.readings;
  what.nominal_rmse_N = without.rmse_N(white_N);
  what.model_rmse_N = with.rmse_N(white_N);
  return {std::move(what), std::move(with.spec)};
}

std::vector<Stability> stability_of(const model::ModelSpec& model, const std::vector<Fold>& folds) {
  std::vector<Stability> out;
  for (std::size_t p = 0; p < model.parts.size(); ++p) {
    const auto& part = model.parts[p];
    if (part.fixed) continue;
    const auto add = [&](std::string_view name, auto&& value_of) {
      Stability one{std::string(part.physics->name) + "." + std::string(name), value_of(part), 1e300, -1e300};
      for (const Fold& fold : folds) {
        const double value = value_of(fold.model.parts[p]);
        one.lowest = std::min(one.lowest, value);
        one.highest = std::max(one.highest, value);
      }
      out.push_back(std::move(one));
    };
    for (std::size_t i = 0; i < part.coefficients.size(); ++i)
      add(part.law->coefficients[i].name, [i](const model::Part& one) { return one.coefficients[i]; });
    for (std::size_t i = 0; i < part.parameters.size(); ++i)
      if (!part.law->parameters[i].fixed)
        add(part.law->parameters[i].name, [i](const model::Part& one) { return one.parameters[i]; });
  }
  return out;
}

}  // namespace

HeldoutStudy study_heldout(const Problem& problem, const model::ModelSpec& nominal, const model::ModelSpec& model,
                           unsigned threads) {
  const Moves found = find_moves(problem.series());
  std::vector<double> velocity, amplitude;
  std::map<std::string, std::vector<std::string>> labels;
  constexpr double kLeastMove = 0.02;
  double widest_mm = 0.0;
  for (const Move& move : found.moves) widest_mm = std::max(widest_mm, move.high_mm - move.low_mm);
  for (const Move& move : found.moves) {
    // Before the first motion, and what only creeps below the noise: never left out.
    if (move.high_mm - move.low_mm < kLeastMove * widest_mm) {
      velocity.push_back(0.0);
      amplitude.push_back(0.0);
      labels["waveform"].emplace_back();
      continue;
    }
    velocity.push_back(move.fastest_mm_s);
    amplitude.push_back(move.high_mm - move.low_mm);
    labels["waveform"].emplace_back(move.reversals < 2                     ? "ramp"
                                    : move.turning_s > 0.5 * move.moving_s ? "sine"
                                                                           : "triangle");
  }
  labels["velocity"] = grouped(velocity, "mm/s");
  labels["amplitude"] = grouped(amplitude, "mm");

  std::vector<LeftOut> wanted;
  std::vector<std::vector<bool>> bins;
  for (const char* by : {"velocity", "amplitude", "waveform"}) {
    const auto& names = labels[by];
    std::map<std::string, double> readings;
    double all = 0.0;
    std::size_t row = 0;
    for (const Series& each : problem.series()) {
      for (const double count : each.count) {
        readings[names[found.of_bin[row++]]] += count;
        all += count;
      }
    }
    constexpr std::size_t kMost = 5;
    std::vector<std::pair<double, std::string>> order;
    for (const auto& [name, count] : readings)
      if (!name.empty() && count >= 50.0 && count < 0.8 * all) order.emplace_back(count, name);
    std::ranges::sort(order, std::greater<>());
    if (readings.size() - readings.count("") < 2) continue;
    if (order.size() > kMost) order.resize(kMost);
    // In the order people look for them: "2 mm/s" before "10 mm/s".
    std::ranges::sort(order, [](const auto& a, const auto& b) {
      const double x = std::atof(a.second.c_str()), y = std::atof(b.second.c_str());
      return x != y ? x < y : a.second < b.second;
    });
    for (const auto& [count, name] : order) {
      wanted.push_back({by, name, count, 0.0, 0.0});
      std::vector<bool> out;
      for (const std::size_t move : found.of_bin) out.push_back(names[move] == name);
      bins.push_back(std::move(out));
    }
  }
  std::vector<Fold> folds(wanted.size());
  base::parallel_for(wanted.size(), threads,
                     [&](std::size_t i) { folds[i] = leave_out(problem, nominal, model, bins[i], wanted[i]); });
  HeldoutStudy study;
  for (const Fold& fold : folds) study.left_out.push_back(fold.what);
  if (!folds.empty()) study.stability = stability_of(model, folds);
  return study;
}

}  // namespace isorig::identify
