#include "model/composed.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "model/catalogue.hpp"
#include "model/elements.hpp"
#include "model/one_recording.hpp"

namespace isorig::model {

std::size_t ModelSpec::coefficient_count() const noexcept {
  std::size_t count = 0;
  for (const Part& part : parts) count += part.coefficients.size();
  return count;
}

std::vector<double> ModelSpec::coefficients() const {
  std::vector<double> all;
  for (const Part& part : parts) all.insert(all.end(), part.coefficients.begin(), part.coefficients.end());
  return all;
}

void ModelSpec::set_coefficients(std::span<const double> values) noexcept {
  std::size_t next = 0;
  for (Part& part : parts)
    for (double& coefficient : part.coefficients) coefficient = values[next++];
}

bool ModelSpec::has(std::string_view physics) const noexcept {
  return std::ranges::any_of(parts, [physics](const Part& part) { return part.physics->name == physics; });
}

void follow_arms(ModelSpec& spec) noexcept {
  for (Part& part : spec.parts) {
    if (part.physics != &element::arm_start()) continue;
    long arm = std::lround(part.parameters[1]);
    for (const Part& other : spec.parts)
      if (other.physics == &element::maxwell() && --arm == 0) part.parameters[0] = other.parameters[0];
  }
}

void fill_from_recording(Part& part, const Reference& reference) {
  for (std::size_t i = 0; i < part.parameters.size(); ++i) {
    switch (part.law->parameters[i].traits.filled_by) {
      case FilledBy::kNothing:
        break;
      case FilledBy::kRecordingDuration:
        part.parameters[i] = reference.duration_s;
        break;
      case FilledBy::kRecordingId:
        part.parameters[i] = reference.recording_id;
        break;
      case FilledBy::kRestLength:
        if (reference.rest_length_mm > 0.0) part.parameters[i] = reference.rest_length_mm;
        break;
    }
  }
}

bool ModelSpec::reads_pressure() const noexcept {
  return std::ranges::any_of(parts, [](const Part& part) {
    return part.physics->traits.pressure != PressureNeed::kNone || part.physics->traits.driven_by_pressure ||
           (part.law->make_table && part.law->name == "pressure");
  });
}

bool ModelSpec::driven_by_pressure() const noexcept {
  return std::ranges::any_of(parts, [](const Part& part) { return part.physics->traits.driven_by_pressure; });
}

Part make_part(const Physics& physics, const Law& law) {
  Part part{&physics, &law, {}, {}, false, {}};
  for (const Parameter& parameter : law.parameters)
    part.parameters.push_back(parameter.starts.empty() ? 0.5 * (parameter.lower + parameter.upper)
                                                       : parameter.starts.front());
  part.coefficients.assign(law.coefficients.size(), 1.0);
  return part;
}

ModelSpec nominal_model(std::string_view name) {
  if (name != "slse1" && name != "slse2") return {};
  ModelSpec spec{std::string(name), {}};
  const auto add = [&spec](const Physics& physics) -> Part& {
    return spec.parts.emplace_back(make_part(physics, physics.laws.front()));
  };
  add(element::spring());
  add(element::maxwell());
  if (name == "slse2") {
    spec.parts.back().parameters[0] = 0.3;
    add(element::maxwell()).parameters[0] = 5.0;
  }
  add(element::constant()).coefficients[0] = 0.0;
  return spec;
}

bool is_of_others(const ModelSpec& spec, const Reference& reference) {
  return spec.seen && !spec.seen->recordings.empty() &&
         std::ranges::find(spec.seen->recordings, reference.recording_id) == spec.seen->recordings.end();
}

double variance_of_further_zero_N2(const ModelSpec& spec) {
  if (!spec.seen || spec.seen->recordings.size() < 2) return 0.0;
  const auto n = static_cast<double>(spec.seen->recordings.size());
  double sum_N = 0.0, squares_N2 = 0.0;  // recordings without a zero of their own are the constant's: 0
  for (const Part& part : spec.parts) {
    if (part.physics != &element::force_zero()) continue;
    sum_N += part.coefficients[0];
    squares_N2 += part.coefficients[0] * part.coefficients[0];
  }
  return (1.0 + 1.0 / n) * std::max(squares_N2 - sum_N * sum_N / n, 0.0) / (n - 1.0);
}

ModelSpec fades_to(const ModelSpec& spec) {
  ModelSpec out{spec.name, spec.seen->nominal, Seen{}, spec.length_scale, spec.pressure_from_psi};
  out.seen->duration_s = spec.seen->duration_s;
  out.seen->recordings = spec.seen->recordings;
  return out;
}

Stage stage_of(const Part& part) noexcept {
  return part.law->traits.scales_specimen ? Stage::kSpecimenShape : part.physics->stage;
}

namespace {
constexpr double kNoEnd = std::numeric_limits<double>::infinity();
}

RunningModel::RunningModel(const ModelSpec& given, const Reference& reference) {
  ModelSpec spec = given;
  follow_arms(spec);
  std::vector<std::size_t> first_of_part;
  std::size_t next = 0;
  for (const Part& part : spec.parts) {
    first_of_part.push_back(next);
    next += part.coefficients.size();
  }
  std::vector<std::size_t> by_stage(spec.parts.size());
  std::iota(by_stage.begin(), by_stage.end(), std::size_t{0});
  std::ranges::stable_sort(by_stage, {}, [&](std::size_t i) { return stage_of(spec.parts[i]); });

  const bool another = is_of_others(spec, reference);
  if (another) zero_N_ = spec.seen->zero_elsewhere_N;
  for (const std::size_t i : by_stage) {
    const Part& part = spec.parts[i];
    const bool zero_of_others = another && part.physics == &element::force_zero() && part.parameters[0] != 0.0;
    running_.push_back({zero_of_others         ? element::force_zero_elsewhere(spec.seen->recordings.size())
                        : part.law->make_table ? part.law->make_table(part.table, reference)
                                               : part.law->make(part.parameters, reference),
                        stage_of(part), coefficients_.size(),
                        spec.seen && part.law->traits.counts == Counts::kTime ? spec.seen->duration_s : kNoEnd, kNoEnd,
                        !(another && of_one_recording(part))});
    for (std::size_t c = 0; c < part.coefficients.size(); ++c) {
      coefficients_.push_back(part.coefficients[c]);
      order_.push_back(first_of_part[i] + c);
    }
    piecewise_ = piecewise_ || part.law->traits.uses_coefficients;
  }
  work_.resize(coefficients_.size());
}

void RunningModel::reset(const Instant& first) noexcept {
  for (Running& running : running_) {
    running.process->reset(first);
    running.until_s = first.t_s + running.known_s;
  }
}

void RunningModel::set_coefficients(std::span<const double> values) noexcept {
  for (std::size_t i = 0; i < order_.size(); ++i) coefficients_[i] = values[order_[i]];
}

void RunningModel::run(Instant now) noexcept {
  if (std::isnan(now.slide_mm)) now.slide_mm = now.step_mm;
  std::ranges::fill(work_, 0.0);
  for (Running& running : running_) {
    switch (running.stage) {
      case Stage::kKinematics:
        running.process->move(now);
        break;
      case Stage::kSpecimen:
      case Stage::kRig:
      case Stage::kSensor:
        if (!running.acts) break;
        if (now.t_s > running.until_s) {
          Instant held = now;
          held.t_s = running.until_s;
          running.process->force(held, work_.data() + running.first_column);
        } else {
          running.process->force(now, work_.data() + running.first_column);
        }
        break;
      case Stage::kSpecimenShape:
      case Stage::kSensorLag:
      case Stage::kSensorDelay:
        // first_column counts the columns of the stages before it: what it acts on.
        running.process->shape(now, {work_.data(), running.first_column}, {coefficients_.data(), running.first_column});
        break;
    }
  }
}

void RunningModel::step_columns(Instant now, std::span<double> columns) noexcept {
  run(now);
  for (std::size_t i = 0; i < work_.size(); ++i) columns[order_[i]] = work_[i];
}

double RunningModel::step(Instant now) noexcept {
  run(now);
  return std::transform_reduce(work_.begin(), work_.end(), coefficients_.begin(), zero_N_);
}

}  // namespace isorig::model
