#include "identify/diagnose/fit/left_out.hpp"

#include <algorithm>
#include <cmath>

#include "base/parallel.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/fading.hpp"
#include "identify/diagnose/fit/intervals.hpp"
#include "model/elements.hpp"

namespace isorig::identify {
bool is_state(const model::Part& part) {
  return part.physics == &model::element::arm_start() || part.physics == &model::element::force_zero() ||
         model::is_event(*part.law) || model::describes_recording(*part.law);
}

std::vector<Series> without(std::span<const Series> series, const std::vector<bool>& out) {
  std::vector<Series> kept(series.begin(), series.end());
  std::size_t row = 0;
  for (Series& each : kept)
    for (double& count : each.count)
      if (out[row++]) count = 0.0;
  return kept;
}

namespace {

struct Relearnt {
  model::ModelSpec spec;
  Eigen::VectorXd error_N;  ///< of every bin, left out or not
};

/// Every model is given the states that fit it best, from all readings; what it has learnt stays.
void see_states(std::span<const Series> series, std::vector<model::Part>& parts) {
  if (std::ranges::none_of(parts, is_state)) return;
  model::ModelSpec spec{"", parts};
  for (model::Part& part : spec.parts) part.fixed = !is_state(part);
  Eigen::VectorXd ignored;
  (void)Problem(series, {1.0, 0.0, 1.0}).solve(spec, ignored);
  for (std::size_t i = 0; i < parts.size(); ++i) parts[i].coefficients = spec.parts[i].coefficients;
}

Relearnt learn_without(std::span<const Series> series, const Learner& learner, const std::vector<bool>& out) {
  Relearnt relearnt;
  relearnt.spec = learner(without(series, out));
  see_states(series, relearnt.spec.parts);
  if (relearnt.spec.seen) see_states(series, relearnt.spec.seen->nominal);
  relearnt.error_N.resize(static_cast<Eigen::Index>(out.size()));
  Eigen::Index bin = 0;
  for (const Series& each : series) {
    const std::vector<double> force_N = faded_force(relearnt.spec, each);
    for (std::size_t k = 0; k < force_N.size(); ++k) relearnt.error_N[bin++] = each.force_N[k] - force_N[k];
  }
  return relearnt;
}

std::size_t folds_of(const Blocks& blocks) {
  return std::min(deciding().left_out_folds, blocks.count);
}

std::size_t fold_of(const Blocks& blocks, std::size_t block) {
  // Of strokes two at a time, there and back: the strokes that are left would else lean to one direction.
  const bool strokes = blocks.kind == BlockKind::kStrokes || blocks.kind == BlockKind::kPressureStrokes;
  return block / (strokes ? 2 : 1) % folds_of(blocks);
}

std::vector<bool> bins_of_fold(const Blocks& blocks, std::size_t fold) {
  std::vector<bool> out;
  out.reserve(blocks.of_bin.size());
  for (const std::size_t block : blocks.of_bin) out.push_back(fold_of(blocks, block) == fold);
  return out;
}

/// Bins of one stroke follow each other.
void add_bin(Prediction& to, const LeftOutBin& bin) {
  if (bin.readings <= 0.0) return;
  const double squares_N2 = bin.readings * bin.error_N * bin.error_N;
  to.squares_N2 += squares_N2;
  to.readings += bin.readings;
  to.bins += 1.0;
  if (to.each_bin.empty() || to.each_bin.back().stroke != bin.stroke) to.squares_of_stroke.push_back(0.0);
  to.squares_of_stroke.back() += squares_N2;
  to.each_bin.push_back(bin);
}

}  // namespace

Learner refit(const model::ModelSpec& spec, const NoiseModel& noise, int iterations) {
  return [spec, noise, iterations](std::span<const Series> kept) {
    return Problem(kept, noise).fit(spec, iterations).spec;
  };
}

double Prediction::rmse_N(double white_N) const {
  if (readings <= 0.0) return 0.0;
  return std::sqrt(squares_N2 / readings + white_N * white_N * std::max(1.0 - bins / readings, 0.0));
}

Prediction predict_left_out(std::span<const Series> series, const Learner& learner, const std::vector<bool>& out,
                            const Blocks& strokes) {
  Relearnt relearnt = learn_without(series, learner, out);
  Prediction prediction;
  std::size_t row = 0;
  for (const Series& each : series) {
    for (const double count : each.count) {
      if (out[row]) add_bin(prediction, {count, relearnt.error_N[static_cast<Eigen::Index>(row)], strokes.of_bin[row]});
      ++row;
    }
  }
  prediction.spec = std::move(relearnt.spec);
  return prediction;
}

double learning_error_N2(std::span<const Series> series, const model::ModelSpec& learnt, const NoiseModel& noise,
                         const std::vector<bool>& out) {
  const std::vector<FreeNumber> numbers = fitted_numbers(learnt);
  if (numbers.empty()) return 0.0;
  const std::vector<Series> kept = without(series, out);
  const Problem all(series, noise);
  const Eigen::MatrixXd moved = differences(learnt, numbers, all.predict(learnt),
                                            [&](const model::ModelSpec& spec) { return all.predict(spec); });
  const Eigen::VectorXd variance_N2 =
      variance_by_numbers(learnt, numbers, covariance(Problem(kept, noise), learnt, Spread::kMoves), moved);
  double sum = 0.0;
  Eigen::Index row = 0;
  for (const Series& each : series) {
    for (const double count : each.count) {
      if (out[static_cast<std::size_t>(row)] && count > 0.0) sum += count * variance_N2[row];
      ++row;
    }
  }
  return std::max(sum, 0.0);
}

Prediction mixed(const Prediction& nominal, const Prediction& model, double share) {
  Prediction out;
  out.spec = model.spec;
  if (out.spec.seen) out.spec.seen->share = share;
  for (std::size_t i = 0; i < model.each_bin.size(); ++i) {
    LeftOutBin bin = model.each_bin[i];
    bin.error_N = share * bin.error_N + (1.0 - share) * nominal.each_bin[i].error_N;
    add_bin(out, bin);
  }
  return out;
}

std::vector<bool> left_out_with(const Blocks& blocks, std::size_t block) {
  return bins_of_fold(blocks, fold_of(blocks, block));
}

std::vector<Prediction> predict_blocks(std::span<const Series> series, const Learner& learner, const Blocks& blocks,
                                       unsigned threads) {
  if (blocks.kind == BlockKind::kNone) return {};
  std::vector<Prediction> predictions(blocks.count);
  base::parallel_for(folds_of(blocks), threads, [&](std::size_t fold) {
    const std::vector<bool> out = bins_of_fold(blocks, fold);
    const Relearnt relearnt = learn_without(series, learner, out);
    std::size_t row = 0;
    for (const Series& each : series) {
      for (const double count : each.count) {
        if (out[row])
          add_bin(predictions[blocks.of_bin[row]],
                  {count, relearnt.error_N[static_cast<Eigen::Index>(row)], blocks.of_bin[row]});
        ++row;
      }
    }
    for (std::size_t block = 0; block < blocks.count; ++block)
      if (fold_of(blocks, block) == fold) predictions[block].spec = relearnt.spec;
  });
  return predictions;
}

Prediction together(std::span<const Prediction> blocks) {
  Prediction all;
  for (const Prediction& block : blocks) {
    if (block.readings == 0.0) continue;
    all.squares_N2 += block.squares_N2;
    all.readings += block.readings;
    all.bins += block.bins;
    all.squares_of_stroke.push_back(block.squares_N2);
  }
  return all;
}

}  // namespace isorig::identify
