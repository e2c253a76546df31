#include "proof/baselines/library.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace isorig::proof {
namespace {

using Column = Eigen::VectorXd;

std::span<const double> span_of(const Column& c) {
  return {c.data(), static_cast<std::size_t>(c.size())};
}

double at_time(std::span<const double> t_s, std::span<const double> values, double when_s) {
  const auto after = std::ranges::upper_bound(t_s, when_s);
  if (after == t_s.begin()) return values.front();
  if (after == t_s.end()) return values.back();
  const std::size_t i = static_cast<std::size_t>(after - t_s.begin());
  const double part = (when_s - t_s[i - 1]) / (t_s[i] - t_s[i - 1]);
  return values[i - 1] + part * (values[i] - values[i - 1]);
}

Column delayed(std::span<const double> t_s, std::span<const double> values, double delay_s) {
  Column out(static_cast<Eigen::Index>(t_s.size()));
  for (std::size_t i = 0; i < t_s.size(); ++i)
    out[static_cast<Eigen::Index>(i)] = at_time(t_s, values, t_s[i] - delay_s);
  return out;
}

Column played(std::span<const double> position_mm, double width_mm) {
  Column out(static_cast<Eigen::Index>(position_mm.size()));
  double at_mm = position_mm.front();
  for (std::size_t i = 0; i < position_mm.size(); ++i) {
    at_mm = std::clamp(at_mm, position_mm[i] - 0.5 * width_mm, position_mm[i] + 0.5 * width_mm);
    out[static_cast<Eigen::Index>(i)] = at_mm;
  }
  return out;
}

Column travelled(std::span<const double> position_mm) {
  const Column quiet = played(position_mm, 0.01);  // ten micrometres of play keep noise from adding up
  Column travel = Column::Zero(quiet.size());
  for (Eigen::Index i = 1; i < quiet.size(); ++i) travel[i] = travel[i - 1] + std::abs(quiet[i] - quiet[i - 1]);
  return travel;
}

/// Second derivative by a parabola through nine neighbours, where the recording is dense.
Column accelerations(const messages::FrameSamples& frame) {
  Column out = Column::Zero(static_cast<Eigen::Index>(frame.size()));
  constexpr std::ptrdiff_t kReach = 4;
  for (std::size_t i = kReach; i + kReach < frame.size(); ++i) {
    const double span_s = frame.t_s[i + kReach] - frame.t_s[i - kReach];
    if (span_s > 0.1) continue;
    Eigen::Matrix3d gram = Eigen::Matrix3d::Zero();
    Eigen::Vector3d moment = Eigen::Vector3d::Zero();
    for (std::size_t j = i - kReach; j <= i + kReach; ++j) {
      const double s = (frame.t_s[j] - frame.t_s[i]) / span_s;
      const Eigen::Vector3d row(1.0, s, s * s);
      gram += row * row.transpose();
      moment += row * frame.position_mm[j];
    }
    out[static_cast<Eigen::Index>(i)] = 2.0 * (gram.inverse() * moment)[2] / (span_s * span_s) * 1e-3;
  }
  return out;
}

Column pressure_change(const messages::Recording& recording) {
  const auto rows = static_cast<Eigen::Index>(recording.frame.size());
  if (!recording.pressure || recording.pressure->size() == 0) return Column::Zero(rows);
  const auto& p = *recording.pressure;
  const double mean =
      std::accumulate(p.pressure_psi.begin(), p.pressure_psi.end(), 0.0) / static_cast<double>(p.size());
  Column out(rows);
  for (Eigen::Index i = 0; i < rows; ++i)
    out[i] = at_time(p.t_s, p.pressure_psi, recording.frame.t_s[static_cast<std::size_t>(i)]) - mean;
  return out;
}

class Builder {
 public:
  Builder(const messages::Recording& recording, const NominalFit& nominal) : frame_(recording.frame), fit_(nominal) {
    add_base();
  }
  void add(std::string_view effect, std::vector<Column> columns, bool searched = false) {
    library_.variants.push_back(
        {effect, static_cast<int>(columns_.size()), static_cast<int>(columns.size()), searched});
    for (Column& c : columns) columns_.push_back(std::move(c));
  }
  [[nodiscard]] Column nominal_of(std::span<const double> position_mm) const {
    return nominal_columns(frame_.t_s, position_mm, fit_.time_constants_s) * fit_.coefficients;
  }
  [[nodiscard]] Library finish() {
    library_.columns.resize(static_cast<Eigen::Index>(frame_.size()), static_cast<Eigen::Index>(columns_.size()));
    for (std::size_t i = 0; i < columns_.size(); ++i) library_.columns.col(static_cast<Eigen::Index>(i)) = columns_[i];
    return std::move(library_);
  }

 private:
  void add_base() {
    const Eigen::MatrixXd nominal = nominal_columns(frame_.t_s, frame_.position_mm, fit_.time_constants_s);
    for (Eigen::Index i = 0; i < nominal.cols(); ++i) columns_.push_back(nominal.col(i));
    for (std::size_t i = 0; i < fit_.time_constants_s.size(); ++i) {
      constexpr double kPart = 0.02;
      columns_.push_back((maxwell_column(frame_.t_s, frame_.position_mm, fit_.time_constants_s[i] * (1.0 + kPart)) -
                          nominal.col(static_cast<Eigen::Index>(i) + 1)) /
                         kPart);
    }
    library_.base = static_cast<int>(columns_.size());
  }
  const messages::FrameSamples& frame_;
  const NominalFit& fit_;
  std::vector<Column> columns_;
  Library library_;
};

}  // namespace

Library build_library(const messages::Recording& recording, const NominalFit& nominal, double slip_at_s) {
  const messages::FrameSamples& frame = recording.frame;
  const auto rows = static_cast<Eigen::Index>(frame.size());
  const Eigen::Map<const Column> x(frame.position_mm.data(), rows);
  const Eigen::Map<const Column> t(frame.t_s.data(), rows);
  Builder b(recording, nominal);
  const Column force = b.nominal_of(frame.position_mm);

  for (const double reach_mm : {0.005, 0.02, 0.06})
    b.add("coulomb_friction", {(x - played(frame.position_mm, 2.0 * reach_mm)) / reach_mm}, true);
  b.add("strain_stiffening", {x.array().square()});
  b.add("strain_stiffening", {x.array().square(), x.array().cube()});
  for (double time_s = 0.02; time_s < 400.0; time_s *= 4.0)
    b.add("second_relaxation", {maxwell_column(frame.t_s, frame.position_mm, time_s)}, true);
  for (const double arm_s : nominal.time_constants_s) {
    const Column z = maxwell_column(frame.t_s, frame.position_mm, arm_s);
    b.add("nonlinear_viscosity", {z.array().sign() * z.array().abs().sqrt()}, true);
    b.add("nonlinear_viscosity", {z.array() * z.array().abs()}, true);
  }
  const Column dp = pressure_change(recording);
  b.add("pressure_coupling", {dp});
  b.add("pressure_coupling", {dp, dp.cwiseProduct(x)});
  const Column travel = travelled(frame.position_mm);
  for (const double scale_mm : {6.0, 20.0, 60.0}) {
    const Column worn = 1.0 - (-travel.array() / scale_mm).exp();
    b.add("cyclic_softening", {worn.cwiseProduct(x), worn}, true);
  }
  for (const double lag_s : {0.005, 0.015, 0.04})
    b.add("force_lag", {-maxwell_column(frame.t_s, span_of(force), lag_s)}, true);
  for (const double delay_s : {0.005, 0.015, 0.04})
    b.add("force_delay", {delayed(frame.t_s, span_of(force), delay_s) - force}, true);
  b.add("fixture_inertia", {accelerations(frame)});
  b.add("zero_drift", {t / 4000.0});
  b.add("zero_drift", {t / 4000.0, (t / 4000.0).array().square()});
  b.add("grip_slip", {(t.array() > slip_at_s).cast<double>()}, true);
  for (const double width_mm : {0.03, 0.1, 0.25})
    b.add("crosshead_backlash", {b.nominal_of(span_of(played(frame.position_mm, width_mm))) - force}, true);
  b.add("slack", {(-force).cwiseMax(0.0)});
  return b.finish();
}

double likeliest_step_s(const messages::FrameSamples& frame, const Eigen::VectorXd& residual_N) {
  const Eigen::Index rows = residual_N.size();
  const double mean = residual_N.mean();
  double before = 0.0, best = -1.0, when_s = INFINITY;
  constexpr Eigen::Index kEdge = 100;
  for (Eigen::Index i = 0; i + kEdge < rows; ++i) {
    before += residual_N[i] - mean;
    const double gain = before * before / (static_cast<double>(i + 1) * static_cast<double>(rows - i - 1));
    if (i >= kEdge && gain > best) {
      best = gain;
      when_s = frame.t_s[static_cast<std::size_t>(i)];
    }
  }
  return when_s;
}

Eigen::MatrixXd lagged_columns(const messages::Recording& recording) {
  const messages::FrameSamples& frame = recording.frame;
  const auto rows = static_cast<Eigen::Index>(frame.size());
  const Eigen::Map<const Column> x(frame.position_mm.data(), rows);
  std::vector<Column> columns{x, x.array().square(), x.array().cube(), pressure_change(recording)};
  for (const double lag_s : {0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0}) {
    const Column moved = x - delayed(frame.t_s, frame.position_mm, lag_s);
    columns.push_back(moved);
    columns.push_back(moved.array() * moved.array().abs());
    columns.push_back((moved.array() / 0.02).tanh());  // which way it has moved
  }
  Eigen::MatrixXd all(rows, static_cast<Eigen::Index>(columns.size()));
  for (std::size_t i = 0; i < columns.size(); ++i) all.col(static_cast<Eigen::Index>(i)) = columns[i];
  return all;
}

}  // namespace isorig::proof
