#include "identify/diagnose/explain/pictured.hpp"

#include <algorithm>
#include <cmath>

#include "identify/diagnose/fit/fading.hpp"

namespace isorig::identify {
namespace {

/// Where each series begins among the bins of all; one past the end last.
std::vector<std::size_t> first_bins(std::span<const Series> series) {
  std::vector<std::size_t> out{0};
  for (const Series& each : series) out.push_back(out.back() + each.nodes.size());
  return out;
}

/// Neighbouring bins of one series, among the bins of all.
struct Run {
  std::size_t series = 0, first = 0, end = 0;
};

std::vector<Run> runs_of(std::span<const Series> series, const std::vector<bool>& of) {
  std::vector<Run> out;
  const std::vector<std::size_t> begins = first_bins(series);
  for (std::size_t s = 0; s < series.size(); ++s) {
    bool inside = false;
    for (std::size_t bin = begins[s]; bin < begins[s + 1]; ++bin) {
      if (of[bin] && !inside) out.push_back({s, bin, bin});
      inside = of[bin];
      if (inside) out.back().end = bin + 1;
    }
  }
  return out;
}

std::vector<bool> bins_of(const Blocks& blocks, std::size_t block) {
  std::vector<bool> out;
  out.reserve(blocks.of_bin.size());
  for (const std::size_t each : blocks.of_bin) out.push_back(each == block);
  return out;
}

/// Measured minus predicted, of every bin of all series.
std::vector<double> errors_N(std::span<const Series> series, const model::ModelSpec& spec) {
  std::vector<double> out;
  for (const Series& each : series) {
    const std::vector<double> force_N = faded_force(spec, each);
    for (std::size_t k = 0; k < force_N.size(); ++k) out.push_back(each.force_N[k] - force_N[k]);
  }
  return out;
}

/// Squares over the bins with `of`, as a prediction's.
Prediction squares_of(std::span<const Series> series, const std::vector<double>& error_N, const std::vector<bool>& of) {
  Prediction sum;
  std::size_t bin = 0;
  for (const Series& each : series) {
    for (const double count : each.count) {
      if (of[bin] && count > 0.0) {
        sum.squares_N2 += count * error_N[bin] * error_N[bin];
        sum.readings += count;
        sum.bins += 1.0;
      }
      ++bin;
    }
  }
  return sum;
}

/// LeftOutStretch::model_error_N of a model that was learnt without `out`.
double error_elsewhere_N(std::span<const Series> series, const Blocks& blocks, std::span<const Prediction> of_blocks,
                         const std::vector<bool>& out, const model::ModelSpec& learnt, double white_N) {
  std::vector<bool> touched(of_blocks.size(), false), kept(out);
  kept.flip();
  if (!of_blocks.empty())
    for (std::size_t bin = 0; bin < out.size(); ++bin)
      if (out[bin]) touched[blocks.of_bin[bin]] = true;
  std::vector<Prediction> others;
  for (std::size_t block = 0; block < of_blocks.size(); ++block)
    if (!touched[block]) others.push_back(of_blocks[block]);
  return std::max(together(others).rmse_N(white_N), squares_of(series, errors_N(series, learnt), kept).rmse_N(white_N));
}

/// Indices of the worst and of the median by that rms; the worst alone where there is one.
std::vector<std::size_t> worst_and_median(const std::vector<double>& rms) {
  std::vector<std::size_t> order(rms.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::ranges::stable_sort(order, {}, [&](std::size_t i) { return rms[i]; });
  if (order.empty()) return {};
  if (order.size() == 1) return {order[0]};
  return {order.back(), order[(order.size() - 1) / 2]};
}

}  // namespace

std::vector<BlockError> block_errors(std::span<const Series> series, const Blocks& blocks,
                                     std::span<const Prediction> nominal, std::span<const Prediction> model,
                                     double white_N) {
  std::vector<BlockError> out;
  std::size_t bin = 0, block = blocks.count;
  for (std::size_t s = 0; s < series.size() && !model.empty(); ++s) {
    for (std::size_t k = 0; k < series[s].nodes.size(); ++k, ++bin) {
      const std::size_t now = blocks.of_bin[bin];
      if (model[now].readings <= 0.0) continue;
      const double t_s = series[s].nodes[k].t_s;
      if (now != block)
        out.push_back({s, series[s].name, t_s, t_s, model[now].readings, nominal[now].rmse_N(white_N),
                       model[now].rmse_N(white_N)});
      block = now;
      out.back().t_end_s = t_s;
    }
  }
  return out;
}

std::vector<LeftOutStretch> stretches_to_draw(std::span<const Series> series, const Blocks& blocks,
                                              std::span<const Prediction> nominal, std::span<const Prediction> model,
                                              std::span<const LeftOutKind> kinds, double white_N) {
  std::vector<LeftOutStretch> stretches;
  const auto draw = [&](const LeftOutKind& what, const std::vector<bool>& within, bool worst, std::size_t of) {
    const bool by_model = what.model.squares_N2 >= what.nominal.squares_N2;
    const std::vector<double> error_N = errors_N(series, by_model ? what.model.spec : what.nominal.spec);
    Run largest;
    double most_N2 = -1.0;
    for (const Run& run : runs_of(series, within)) {
      std::vector<bool> in_run(within.size(), false);
      std::fill(in_run.begin() + static_cast<std::ptrdiff_t>(run.first),
                in_run.begin() + static_cast<std::ptrdiff_t>(run.end), true);
      const double squares_N2 = squares_of(series, error_N, in_run).squares_N2;
      if (squares_N2 <= most_N2) continue;
      most_N2 = squares_N2;
      largest = run;
    }
    const std::size_t begin = first_bins(series)[largest.series];
    stretches.push_back({what.by, what.value, worst, of, largest.series, largest.first - begin, largest.end - begin,
                         what.nominal.rmse_N(white_N), what.model.rmse_N(white_N), what.out, what.nominal.spec,
                         what.model.spec,
                         error_elsewhere_N(series, blocks, nominal, what.out, what.nominal.spec, white_N),
                         error_elsewhere_N(series, blocks, model, what.out, what.model.spec, white_N)});
  };
  const auto larger = [&](const Prediction& a, const Prediction& b) {
    return std::max(a.rmse_N(white_N), b.rmse_N(white_N));
  };
  std::vector<std::size_t> judged;
  std::vector<double> rms;
  for (std::size_t block = 0; block < model.size(); ++block) {
    if (model[block].readings <= 0.0) continue;
    judged.push_back(block);
    rms.push_back(larger(nominal[block], model[block]));
  }
  for (const std::size_t at : worst_and_median(rms)) {
    const std::size_t block = judged[at];
    const std::vector<bool> out = left_out_with(blocks, block);
    draw({"block", "", out, nominal[block], model[block]}, bins_of(blocks, block), stretches.empty(), rms.size());
  }
  rms.clear();
  for (const LeftOutKind& kind : kinds) rms.push_back(larger(kind.nominal, kind.model));
  const std::vector<std::size_t> chosen = worst_and_median(rms);
  for (const std::size_t at : chosen) draw(kinds[at], kinds[at].out, at == chosen.front(), kinds.size());
  return stretches;
}

}  // namespace isorig::identify
