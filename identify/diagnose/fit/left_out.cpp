#include "identify/diagnose/fit/left_out.hpp"

#include <algorithm>
#include <cmath>

#include "base/parallel.hpp"
#include "identify/diagnose/fit/moves.hpp"

namespace isorig::identify {
namespace {

struct Refit {
  model::ModelSpec spec;
  Eigen::VectorXd error_N;  ///< of every bin, fitted or not
};

Refit refit_without(const Problem& problem, const model::ModelSpec& spec, const std::vector<bool>& out,
                    int iterations) {
  std::vector<Series> kept(problem.series().begin(), problem.series().end());
  std::size_t row = 0;
  for (Series& each : kept)
    for (double& count : each.count)
      if (out[row++]) count = 0.0;
  const Problem without(kept, problem.noise());
  Refit refit;
  refit.spec = without.fit(spec, iterations).spec;
  refit.error_N = without.target() - without.predict(refit.spec);
  return refit;
}

void add_bin(Prediction& to, double readings, double error_N) {
  to.squares_N2 += readings * error_N * error_N;
  to.readings += readings;
  to.bins += readings > 0.0 ? 1.0 : 0.0;
}

}  // namespace

double Prediction::rmse_N(double white_N) const {
  if (readings <= 0.0) return 0.0;
  return std::sqrt(squares_N2 / readings + white_N * white_N * std::max(1.0 - bins / readings, 0.0));
}

Prediction predict_left_out(const Problem& problem, const model::ModelSpec& spec, const std::vector<bool>& out,
                            int iterations) {
  Refit refit = refit_without(problem, spec, out, iterations);
  Prediction prediction;
  std::size_t row = 0;
  for (const Series& each : problem.series()) {
    for (const double count : each.count) {
      if (out[row]) add_bin(prediction, count, refit.error_N[static_cast<Eigen::Index>(row)]);
      ++row;
    }
  }
  prediction.spec = std::move(refit.spec);
  return prediction;
}

std::vector<Prediction> predict_moves(const Problem& problem, const model::ModelSpec& spec, unsigned threads) {
  constexpr std::size_t kFolds = 4;
  constexpr int kIterations = 6;
  const MoveNumbers moves = number_moves(problem.series());
  std::vector<Prediction> predictions(moves.count);
  base::parallel_for(kFolds, threads, [&](std::size_t fold) {
    std::vector<bool> out;
    for (const std::size_t move : moves.of_bin) out.push_back(move % kFolds == fold);
    const Refit refit = refit_without(problem, spec, out, kIterations);
    std::size_t row = 0;
    for (const Series& each : problem.series()) {
      for (const double count : each.count) {
        if (out[row]) add_bin(predictions[moves.of_bin[row]], count, refit.error_N[static_cast<Eigen::Index>(row)]);
        ++row;
      }
    }
    for (std::size_t move = fold; move < moves.count; move += kFolds) predictions[move].spec = refit.spec;
  });
  return predictions;
}

double left_out_rmse_N(const Problem& problem, const model::ModelSpec& spec, unsigned threads) {
  Prediction all;
  for (const Prediction& move : predict_moves(problem, spec, threads)) {
    all.squares_N2 += move.squares_N2;
    all.readings += move.readings;
    all.bins += move.bins;
  }
  return all.rmse_N(problem.noise().white_N);
}

}  // namespace isorig::identify
