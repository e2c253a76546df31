#include "identify/twin/twin.hpp"

#include <algorithm>
#include <cmath>

#include "base/formatted.hpp"

namespace isorig::identify::twin {
namespace {

constexpr double k95 = 1.96;
/// Of the readings that the model was fitted to, where it does not say: that of a load cell of 100 N.
constexpr double kUnknownNoise_N = 0.01;
/// 200 s. A parting that took longer to be found is dated to the beginning of these.
constexpr std::size_t kBlocksKept = 2000;

/// Time constants of the arms: Maxwell elements, laws that took the place of one, and further relaxation times.
std::vector<double> arms_of(const model::ModelSpec& spec) {
  std::vector<double> out;
  for (const model::Part& part : spec.parts) {
    if (part.parameters.empty()) continue;
    if (const auto times_of = part.law->traits.relaxation_times_s; times_of != nullptr) {
      const std::vector<double> times_s = times_of(part.parameters);
      out.insert(out.end(), times_s.begin(), times_s.end());
      continue;
    }
    if (part.physics->name == "maxwell" || part.law->traits.replaces_arm) out.push_back(part.parameters.front());
  }
  return out;
}

}  // namespace

StartState::StartState(const model::ModelSpec& spec)
    : times_s_(arms_of(spec)), noise_N_(spec.seen ? std::max(spec.seen->error_N, 1e-6) : kUnknownNoise_N) {
  const auto n = static_cast<Eigen::Index>(times_s_.size());
  root_ = Eigen::MatrixXd::Zero(n, n + 1);
  root_.leftCols(n).diagonal().setConstant(1.0 / kPrior_N);
}

Eigen::VectorXd StartState::decays(double since_s) const {
  Eigen::VectorXd out(static_cast<Eigen::Index>(times_s_.size()));
  for (std::size_t i = 0; i < times_s_.size(); ++i)
    out[static_cast<Eigen::Index>(i)] = std::exp(-since_s / times_s_[i]);
  return out;
}

void StartState::learn(double since_s, double residual_N) {
  const auto n = static_cast<Eigen::Index>(times_s_.size());
  Eigen::RowVectorXd row(n + 1);
  row << decays(since_s).transpose() / noise_N_, residual_N / noise_N_;
  for (Eigen::Index i = 0; i < n; ++i) {  // Givens rotations bring the reading into the root
    const double length = std::hypot(root_(i, i), row[i]), c = root_(i, i) / length, s = row[i] / length;
    const Eigen::RowVectorXd old = root_.row(i).tail(n + 1 - i);
    root_.row(i).tail(n + 1 - i) = c * old + s * row.tail(n + 1 - i);
    row.tail(n + 1 - i) = c * row.tail(n + 1 - i) - s * old;
  }
}

StartState::Share StartState::at(double since_s) const {
  const auto n = static_cast<Eigen::Index>(times_s_.size());
  if (n == 0) return {};
  // x' R^-1 is what both need: times what was measured it is the force, and its length the error.
  const Eigen::VectorXd share = root_.leftCols(n).triangularView<Eigen::Upper>().transpose().solve(decays(since_s));
  return {share.dot(root_.col(n)), share.norm()};
}

namespace {

model::Reference counted_as(const model::ModelSpec& spec, model::Reference reference) {
  reference.nominal_pressure_psi = spec.pressure_from_psi.value_or(reference.nominal_pressure_psi);
  return reference;
}

}  // namespace

Twin::Twin(const model::ModelSpec& spec, const model::Reference& reference)
    : spec_(spec),
      reference_(counted_as(spec, reference)),
      motion_(reference_),
      start_(spec),
      has_band_(spec.seen.has_value()),
      cusum_(cusum_design(std::exp(-kBlock_s / kLongest_s))) {
  // Made anew at the first window, when the readings' noise is known; here for its faults.
  running_ = std::make_unique<RunningForecast>(spec_, reference_, ReadingNoise{});
}

std::vector<std::string> Twin::notes() const {
  return running_->notes();
}

std::vector<Row> Twin::frame(const Reading& reading, bool moved) {
  std::vector<Row> out;
  if (!fault_.empty()) return out;
  if (!std::isfinite(reading.position_mm) || !std::isfinite(reading.force_N)) {
    fault_ = "a reading of the frame is no number";
    return out;
  }
  if (moved) moved_ns_ = std::min(moved_ns_, reading.mono_ns);
  for (const LiveMotion::Row& each : motion_.frame(reading)) {
    const std::optional<Row> row = step(each);
    if (!row) break;
    out.push_back(*row);
  }
  return out;
}

std::optional<Row> Twin::step(const LiveMotion::Row& given) {
  const auto& [reading, now] = given;
  if (!begun_) {
    running_ = std::make_unique<RunningForecast>(spec_, reference_, motion_.noise());
    running_->reset(now);
    start_s_ = now.t_s;
    begun_ = true;
  }
  const RunningForecast::Row predicted = running_->step(now);
  if (!std::isfinite(predicted.force_N) || !std::isfinite(predicted.half_N) ||
      (has_band_ && !(predicted.half_N > 0.0))) {
    fault_ = base::formatted(
        "the model predicts %g +- %g N, which is no number or no band; diagnose again, or choose another one",
        predicted.force_N, predicted.half_N);
    return std::nullopt;
  }
  const double since_s = now.t_s - start_s_;
  if (reading.mono_ns < moved_ns_ && reading.judged) start_.learn(since_s, reading.force_N - predicted.force_N);
  const StartState::Share held = start_.at(since_s);
  Row row{reading.mono_ns, predicted.force_N + held.force_N, 0.0, 0.0, predicted.outside};
  if (!has_band_) return row;
  row.half_N = std::hypot(predicted.half_N, k95 * held.error_N);
  const double residual_N = reading.force_N - row.force_N;
  row.residual = residual_N / (row.half_N / k95);
  judge(reading, row.residual, residual_N);
  return row;
}

void Twin::judge(const Reading& reading, double residual, double residual_N) {
  if (!reading.judged || reading.mono_ns < moved_ns_) {
    if (block_.count > 0) {  // what came before a pause says nothing of what comes after it
      block_ = {};
      cusum_.interrupt();
      correlation_.interrupt();
    }
    return;
  }
  ++judged_;
  if (std::fabs(residual) <= k95) ++covered_;
  constexpr auto kBlock_ns = static_cast<std::int64_t>(kBlock_s * 1e9);
  if (block_.count > 0 && reading.mono_ns - block_.mono_ns >= kBlock_ns) close_block(reading.mono_ns);
  if (block_.count == 0) block_ = {reading.mono_ns, reading.step, 0.0, 0.0, 0};
  block_.sum += residual;
  block_.sum_N += residual_N;
  ++block_.count;
}

std::deque<Twin::Block>::const_iterator Twin::began(std::size_t since) const {
  auto best = recent_.end() - 1, at = recent_.end();
  double sum = 0.0, most = -1.0;
  for (std::size_t n = 1; n <= since; ++n) {
    sum += (--at)->innovation;
    if (const double gain = sum * sum / static_cast<double>(n); gain > most) {
      most = gain;
      best = at;
    }
  }
  return best;
}

void Twin::close_block(std::int64_t now_ns) {
  const Block done = block_;
  block_ = {};
  if (parting_) return;
  const double z = done.sum / static_cast<double>(done.count);
  const bool parted = cusum_.add(z);
  recent_.push_back(done);
  recent_.back().innovation = cusum_.innovation();
  if (recent_.size() > kBlocksKept) recent_.pop_front();
  if (parted) {
    const auto first = began(static_cast<std::size_t>(std::clamp<std::uint64_t>(cusum_.since(), 1, recent_.size())));
    Parting found{first->mono_ns, now_ns, first->step, 0.0};
    std::size_t count = 0;
    for (auto each = first; each != recent_.end(); ++each) {
      found.residual_N += each->sum_N;
      count += each->count;
    }
    found.residual_N /= static_cast<double>(count);
    parting_ = found;
    recent_.clear();
    return;
  }
  if (!learning_) return;
  correlation_.add(z);
  if (static_cast<double>(correlation_.blocks()) * kBlock_s < kLearning_s) return;
  learning_ = false;
  cusum_ = Cusum(cusum_design(correlation_.phi()));
}

}  // namespace isorig::identify::twin
