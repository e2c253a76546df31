#include "identify/diagnose/explain/heldout.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <map>

#include "base/formatted.hpp"
#include "base/parallel.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
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
      const double least_mm = still_mm(each);
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
  return base::formatted("%.3g %s", value, unit);
}

/// Values within a small share of each other are one.
std::vector<std::string> grouped(const std::vector<double>& values, const char* unit) {
  std::vector<double> centres;
  std::vector<std::string> names;
  for (const double value : values) {
    if (value == 0.0) {
      names.emplace_back();
      continue;
    }
    const auto found = std::ranges::find_if(centres, [&](double c) {
      return std::fabs(value - c) <= deciding().alike_share * std::max(std::fabs(c), 1e-6);
    });
    const double centre = found == centres.end() ? centres.emplace_back(value) : *found;
    names.push_back(text_of(centre, unit));
  }
  return names;
}

/// Bins of one kind, to be left out together.
struct Kind {
  std::string by, value;
  double readings = 0.0;
  std::vector<bool> out;
};

/// The kinds that can be left out, the first few: those with enough readings to judge a prediction by, and few enough
/// that the model can be fitted to the rest.
std::vector<Kind> kinds_of(std::span<const Series> series, const char* by,
                           const std::vector<std::string>& label_of_bin) {
  std::map<std::string, double> readings;
  double all = 0.0;
  std::size_t row = 0;
  for (const Series& each : series) {
    for (const double count : each.count) {
      readings[label_of_bin[row++]] += count;
      all += count;
    }
  }
  if (readings.size() - readings.count("") < 2) return {};
  std::vector<std::pair<double, std::string>> order;
  for (const auto& [name, count] : readings)
    if (!name.empty() && count >= deciding().fewest_readings_of_a_kind && count < deciding().most_share_of_a_kind * all)
      order.emplace_back(count, name);
  std::ranges::sort(order, std::greater<>());
  if (order.size() > deciding().most_kinds_left_out) order.resize(deciding().most_kinds_left_out);
  // In the order people look for them: "2 mm/s" before "10 mm/s".
  std::ranges::sort(order, [](const auto& a, const auto& b) {
    const double x = std::atof(a.second.c_str()), y = std::atof(b.second.c_str());
    return x != y ? x < y : a.second < b.second;
  });
  std::vector<Kind> kinds;
  for (const auto& [count, name] : order) {
    kinds.push_back({by, name, count, {}});
    for (const std::string& label : label_of_bin) kinds.back().out.push_back(label == name);
  }
  return kinds;
}

/// Labels of the moves, given to their bins.
std::vector<std::string> of_bins(const std::vector<std::string>& of_moves,
                                 const std::vector<std::size_t>& move_of_bin) {
  std::vector<std::string> labels;
  labels.reserve(move_of_bin.size());
  for (const std::size_t move : move_of_bin) labels.push_back(of_moves[move]);
  return labels;
}

std::vector<Kind> all_kinds(std::span<const Series> series) {
  const Moves found = find_moves(series);
  std::vector<double> velocity, amplitude;
  std::vector<std::string> waveform;
  double widest_mm = 0.0;
  for (const Move& move : found.moves) widest_mm = std::max(widest_mm, move.high_mm - move.low_mm);
  for (const Move& move : found.moves) {
    // Before the first motion, and what only creeps below the noise: never left out.
    const bool moves = move.high_mm - move.low_mm >= deciding().least_move_share * widest_mm;
    velocity.push_back(moves ? move.fastest_mm_s : 0.0);
    amplitude.push_back(moves ? move.high_mm - move.low_mm : 0.0);
    waveform.emplace_back(!moves                                 ? ""
                          : move.reversals < 2                   ? "ramp"
                          : move.turning_s > 0.5 * move.moving_s ? "sine"
                                                                 : "triangle");
  }
  std::vector<Kind> kinds = kinds_of(series, "velocity", of_bins(grouped(velocity, "mm/s"), found.of_bin));
  const auto append = [&kinds](std::vector<Kind> more) {
    kinds.insert(kinds.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
  };
  append(kinds_of(series, "amplitude", of_bins(grouped(amplitude, "mm"), found.of_bin)));
  append(kinds_of(series, "waveform", of_bins(waveform, found.of_bin)));
  std::vector<std::string> recording;
  std::map<std::string, int> seen;  // two folders may have one name, of different parents
  for (const Series& each : series) {
    const int times = ++seen[each.name];
    const std::string label = times == 1 ? each.name : each.name + " (" + std::to_string(times) + ")";
    recording.insert(recording.end(), each.nodes.size(), label);
  }
  append(kinds_of(series, "recording", recording));
  return kinds;
}

/// Squares of both models over the same strokes.
LeftOut compare(std::string by, std::string value, const Prediction& without, const Prediction& with, double white_N) {
  LeftOut out{std::move(by), std::move(value), with.readings, without.rmse_N(white_N), with.rmse_N(white_N)};
  out.strokes = with.squares_of_stroke.size();
  out.more_N2 = with.squares_N2 - without.squares_N2;
  const auto n = static_cast<double>(out.strokes);
  double squares = 0.0;
  for (std::size_t i = 0; i < out.strokes; ++i) {
    const double off = with.squares_of_stroke[i] - without.squares_of_stroke[i] - out.more_N2 / n;
    squares += off * off;
  }
  if (out.strokes > 1) out.more_error_N2 = std::sqrt(n / (n - 1.0) * squares);
  return out;
}

/// Over the fits of the model; where the nominal model was fitted in its place there are no such numbers.
std::vector<Stability> stability_of(const model::ModelSpec& model, const std::vector<Prediction>& all) {
  std::vector<Prediction> folds;
  for (const Prediction& one : all)
    if (std::ranges::equal(one.spec.parts, model.parts, {}, &model::Part::law, &model::Part::law)) folds.push_back(one);
  if (folds.empty()) return {};
  std::vector<Stability> out;
  for (std::size_t p = 0; p < model.parts.size(); ++p) {
    const auto& part = model.parts[p];
    if (part.fixed) continue;
    const auto add = [&](std::string_view name, auto&& value_of) {
      Stability one{std::string(part.physics->name) + "." + std::string(name), value_of(part), 1e300, -1e300};
      for (const Prediction& fold : folds) {
        const double value = value_of(fold.spec.parts[p]);
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

struct LeaveOut::Cached {
  std::vector<Kind> kinds;
  Blocks blocks, strokes;
  std::vector<Prediction> nominal_blocks, nominal_kinds;
};

LeaveOut::LeaveOut(std::span<const Series> series, double white_N, const Learner& nominal, unsigned threads)
    : series_(series), white_N_(white_N), threads_(threads), cached_(std::make_unique<Cached>()) {
  cached_->kinds = all_kinds(series);
  cached_->blocks = blocks_of(series);
  cached_->strokes = strokes_of(series);
  cached_->nominal_blocks = predict_blocks(series, nominal, cached_->blocks, threads);
  cached_->nominal_kinds = predict_kinds(nominal);
}

LeaveOut::~LeaveOut() = default;

std::vector<Prediction> LeaveOut::predict_kinds(const Learner& learner) const {
  const auto& kinds = cached_->kinds;
  std::vector<Prediction> out(kinds.size());
  base::parallel_for(kinds.size(), threads_, [&](std::size_t i) {
    out[i] = predict_left_out(series_, learner, kinds[i].out, cached_->strokes);
  });
  return out;
}

HeldoutStudy LeaveOut::compared(const model::ModelSpec& model, const std::vector<Prediction>& blocks,
                                const std::vector<Prediction>& kinds) const {
  HeldoutStudy study;
  study.blocks = cached_->blocks.kind;
  if (!blocks.empty()) study.all = compare("block", "", together(cached_->nominal_blocks), together(blocks), white_N_);
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    const Kind& kind = cached_->kinds[i];
    study.left_out.push_back(compare(kind.by, kind.value, cached_->nominal_kinds[i], kinds[i], white_N_));
  }
  if (!kinds.empty()) study.stability = stability_of(model, kinds);
  study.each_block = block_errors(series_, cached_->blocks, cached_->nominal_blocks, blocks, white_N_);
  std::vector<LeftOutKind> left_out;
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    const Kind& kind = cached_->kinds[i];
    left_out.push_back({kind.by, kind.value, kind.out, cached_->nominal_kinds[i], kinds[i]});
  }
  study.to_draw = stretches_to_draw(series_, cached_->blocks, cached_->nominal_blocks, blocks, left_out, white_N_);
  return study;
}

LeaveOut::Predictions LeaveOut::predict(const Learner& learner, const NoiseModel& noise) const {
  Predictions out{predict_blocks(series_, learner, cached_->blocks, threads_), predict_kinds(learner), {}};
  out.learning_N2.assign(out.kinds.size(), 0.0);
  base::parallel_for(out.kinds.size(), threads_, [&](std::size_t i) {
    if (out.kinds[i].squares_N2 > cached_->nominal_kinds[i].squares_N2)
      out.learning_N2[i] = learning_error_N2(series_, out.kinds[i].spec, noise, cached_->kinds[i].out);
  });
  return out;
}

HeldoutStudy LeaveOut::study(const model::ModelSpec& model, const Predictions& predictions, double share) const {
  const auto shared = [&](const std::vector<Prediction>& nominal, std::vector<Prediction> with) {
    if (share < 1.0)
      for (std::size_t i = 0; i < with.size(); ++i) with[i] = mixed(nominal[i], with[i], share);
    return with;
  };
  HeldoutStudy study = compared(model, shared(cached_->nominal_blocks, predictions.blocks),
                                shared(cached_->nominal_kinds, predictions.kinds));
  // Noise in the numbers moves the force of the model, and of that a share is predicted.
  for (std::size_t i = 0; i < study.left_out.size(); ++i)
    study.left_out[i].learning_N2 = share * share * predictions.learning_N2[i];
  return study;
}

HeldoutStudy LeaveOut::study_of_nominal(const model::ModelSpec& nominal) const {
  return compared(nominal, cached_->nominal_blocks, cached_->nominal_kinds);
}

}  // namespace isorig::identify
