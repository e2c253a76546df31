#include "identify/diagnose/explain/discernible.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/parallel.hpp"
#include "base/quantile.hpp"
#include "identify/diagnose/deciding/deciding.hpp"
#include "identify/diagnose/fit/free_parameters.hpp"
#include "identify/diagnose/fit/intervals.hpp"
#include "model/catalogue.hpp"
#include "model/elements.hpp"
#include "model/length_scale.hpp"

namespace isorig::identify {
namespace {

constexpr double kNothing = 1e-6;

/// What one law adds: a column a start, off the span of the nominal model, scaled to 1 N.
struct Signature {
  const model::Physics* effect = nullptr;
  const model::Law* law = nullptr;
  Eigen::MatrixXd columns;
  Eigen::VectorXd whole;  ///< lengths of the columns before the nominal model was taken out
};

/// Orthonormal columns of the same span.
Eigen::MatrixXd basis_of(const Eigen::MatrixXd& columns) {
  if (columns.cols() == 0) return columns;
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(columns);
  qr.setThreshold(1e-9);
  return qr.householderQ() * Eigen::MatrixXd::Identity(columns.rows(), qr.rank());
}

Eigen::MatrixXd off(const Eigen::MatrixXd& basis, const Eigen::MatrixXd& columns) {
  return columns - basis * (basis.transpose() * columns);
}

Eigen::MatrixXd whitened(const Problem& problem, const Eigen::MatrixXd& columns) {
  RowMatrix out = columns;
  (void)whiten(problem.series(), problem.noise(), out);
  return out;
}

/// Derivatives of the whitened nominal force by its numbers.
Eigen::MatrixXd tangents(const Problem& problem, const model::ModelSpec& nominal) {
  const auto force = [&](const model::ModelSpec& spec) -> Eigen::VectorXd {
    return whitened(problem, problem.predict(spec));
  };
  std::vector<FreeNumber> numbers = free_parameters(nominal);
  for (const FreeNumber& coefficient : free_coefficients(nominal)) numbers.push_back(coefficient);
  return differences(nominal, numbers, force(nominal), force);
}

/// The law beside the nominal model, at one of its starts, with 1 N, 1 N/mm ... of each of its coefficients in turn.
std::vector<model::ModelSpec> with_law(const Hypothesis& base, const model::Physics& effect, const model::Law& law,
                                       std::size_t start, const Series& series) {
  model::ModelSpec spec = base.fit.spec;
  model::Part part = started_part(effect, law, start, series.excitation.reference);
  if (model::is_event(law)) part.parameters[model::event_parameter(law)] = series.nodes[series.nodes.size() / 2].t_s;
  if (law.traits.replaces_arm) {
    const auto arm = std::ranges::find(spec.parts, &model::element::maxwell(), &model::Part::physics);
    if (arm == spec.parts.end()) return {};
    part.parameters[0] = arm->parameters[0];
    part.coefficients = arm->coefficients;
    spec.parts.erase(arm);
    spec.parts.push_back(std::move(part));
    return {std::move(spec)};
  }
  std::vector<model::ModelSpec> out;
  for (std::size_t c = 0; c < std::max<std::size_t>(part.coefficients.size(), 1); ++c) {
    for (std::size_t i = 0; i < part.coefficients.size(); ++i) part.coefficients[i] = i == c ? 1.0 : 0.0;
    out.push_back(spec);
    out.back().parts.push_back(part);
  }
  return out;
}

Signature signature_of(const Problem& problem, const Hypothesis& base, const Eigen::MatrixXd& nominal,
                       const model::Physics& effect, const model::Law& law) {
  const Eigen::VectorXd before = problem.predict(base.fit.spec);
  std::size_t starts = 1;
  for (const auto& parameter : law.parameters) starts = std::max(starts, parameter.starts.size());
  std::vector<Eigen::VectorXd> added;
  for (std::size_t start = 0; start < starts; ++start) {
    for (const model::ModelSpec& spec : with_law(base, effect, law, start, problem.series()[0])) {
      const Eigen::VectorXd change = problem.predict(spec) - before;
      std::vector<double> sizes(change.data(), change.data() + change.size());
      for (double& size : sizes) size = std::fabs(size);
      const double most_N = *std::ranges::max_element(sizes),
                   size_N = base::quantile(std::move(sizes), deciding().size_quantile);
      // A law that acts in less than a hundredth of the bins has no size by its 99th percentile.
      if (size_N > deciding().rare_law_share * most_N && change.allFinite()) added.push_back(change / size_N);
    }
  }
  Signature out{&effect, &law, Eigen::MatrixXd(before.size(), static_cast<Eigen::Index>(added.size())), {}};
  for (std::size_t i = 0; i < added.size(); ++i) out.columns.col(static_cast<Eigen::Index>(i)) = added[i];
  if (added.empty()) return out;
  out.columns = whitened(problem, out.columns);
  out.whole = out.columns.colwise().norm().transpose();
  out.columns = off(nominal, out.columns);
  return out;
}

}  // namespace

std::vector<Discernible> discernible(const Search& search, const Hypothesis& base, unsigned threads) {
  const Problem& problem = search.instrument_problem();
  const Eigen::MatrixXd nominal = basis_of(tangents(problem, base.fit.spec));
  std::vector<Signature> signatures;
  for (const model::Physics* effect : model::effects()) {
    if (!may_be_tried(*effect, base, problem.series())) continue;
    for (const model::Law& law : effect->laws)
      if (law.make) signatures.push_back({effect, &model::law_at(law, base.fit.spec.length_scale), {}, {}});
  }
  std::vector<Eigen::MatrixXd> spans(signatures.size());
  base::parallel_for(signatures.size(), threads, [&](std::size_t i) {
    signatures[i] = signature_of(problem, base, nominal, *signatures[i].effect, *signatures[i].law);
    spans[i] = basis_of(signatures[i].columns);
  });

  std::vector<Discernible> out;
  for (const model::Physics* effect : model::effects()) {
    Discernible one{effect, nullptr, std::numeric_limits<double>::infinity(), nullptr, 0.0};
    Eigen::VectorXd shown;
    double whole = 0.0;
    for (const Signature& signature : signatures) {
      if (signature.effect != effect) continue;
      if (one.law == nullptr) one.law = signature.law;
      for (Eigen::Index c = 0; c < signature.columns.cols(); ++c) {
        const double length = signature.columns.col(c).norm();
        if (length <= kNothing * signature.whole[c] || deciding().seen_deviations / length >= one.seen_from_N) continue;
        one.seen_from_N = deciding().seen_deviations / length;
        one.law = signature.law;
        shown = signature.columns.col(c);
        whole = signature.whole[c];
      }
    }
    if (one.law == nullptr) continue;
    one.told_from_N = one.seen_from_N;
    for (std::size_t r = 0; r < signatures.size() && shown.size() > 0; ++r) {
      if (signatures[r].effect == effect || spans[r].cols() == 0) continue;
      const double left = off(spans[r], shown).norm();
      const double told_N =
          left <= kNothing * whole ? std::numeric_limits<double>::infinity() : deciding().seen_deviations / left;
      if (one.nearest != nullptr && told_N <= one.told_from_N) continue;
      one.nearest = signatures[r].effect;
      one.told_from_N = told_N;
    }
    out.push_back(one);
  }
  return out;
}

}  // namespace isorig::identify
