#include "sim/rig.hpp"

#include <algorithm>
#include <utility>

namespace isorig::sim {
namespace {
constexpr double kStep_s = 1e-9 * static_cast<double>(Rig::kStep_ns);

RigOptions resolved(RigOptions options) {
  if (options.start_ns == RigOptions::kNow) {
    options.start_ns = options.clock != nullptr ? options.clock->now_ns() : 0;
  }
  return options;
}
}  // namespace

Rig::Rig(const SimConfig& config) : Rig(config, load_specimen(config.specimen)) {}

Rig::Rig(const SimConfig& config, const Specimen& specimen, const RigOptions& options)
    : specimen_(specimen),
      options_(resolved(options)),
      now_ns_(options_.start_ns),
      physics_(specimen.actuator, config.physics),
      pneumatics_(config.pneumatics, 1e-3 * physics_.actuator().volume_mm3(0.0), kStep_s),
      frame_(config.frame, *this, config.seed, options_.start_ns, kStep_s),
      pressure_(config.pressure, config.pneumatics, *this, config.seed, options_.start_ns),
      interlock_(*this) {
  truth_.mono_ns = options_.start_ns;
  truth_.supply_psi = pneumatics_.supply_psi();
  truth_.force_N = physics_.force_N();
  step_.begin_ns = options_.start_ns;
  step_.length_ns = kStep_ns;
}

Host::Visit Rig::enter() {
  Visit visit;
  if (options_.threaded) visit.lock = std::unique_lock(mutex_);
  if (options_.clock != nullptr) advance_unlocked(options_.clock->now_ns());
  visit.now_ns = now_ns_;
  return visit;
}

void Rig::advance(std::int64_t now_ns) {
  std::unique_lock<std::mutex> lock;
  if (options_.threaded) lock = std::unique_lock(mutex_);
  advance_unlocked(now_ns);
}

void Rig::advance_unlocked(std::int64_t now_ns) noexcept {
  if (now_ns <= now_ns_) return;
  now_ns_ = now_ns;
  while (step_.begin_ns + kStep_ns <= now_ns) step();
}

Truth Rig::truth() {
  const Visit visit = enter();
  truth_.supply_psi = pneumatics_.supply_psi();
  return truth_;
}

std::vector<Truth> Rig::take_truth() {
  const Visit visit = enter();
  return std::exchange(kept_, {});
}

void Rig::step() noexcept {
  ValveTargets valves = pressure_.before_step(step_.begin_ns);
  if (regulator_.present) {
    valves.fill *= regulator_.fill;
    valves.vent = std::max(valves.vent, regulator_.vent);
  }
  valves.dump = interlock_.dump_opening();
  frame_.before_step(step_.begin_ns, interlock_.drive_enabled());

  step_.position_begin_mm = truth_.position_mm;
  step_.force_begin_N = truth_.force_N;
  step_.pressure_begin_psi = truth_.pressure_psi;

  step_.position_end_mm = frame_.crosshead().position_mm();
  pneumatics_.step(valves, 1e-3 * physics_.actuator().volume_mm3(step_.position_end_mm));
  step_.pressure_end_psi = pneumatics_.pressure_psi();
  step_.force_end_N =
      physics_.step(step_.position_end_mm, frame_.crosshead().velocity_mm_s(), step_.pressure_end_psi, kStep_s);

  frame_.after_step(step_);
  pressure_.after_step(step_);

  step_.begin_ns += kStep_ns;
  truth_.mono_ns = step_.begin_ns;
  truth_.position_mm = step_.position_end_mm;
  truth_.velocity_mm_s = frame_.crosshead().velocity_mm_s();
  truth_.force_N = step_.force_end_N;
  truth_.pressure_psi = step_.pressure_end_psi;
  if (options_.keep_truth) kept_.push_back(truth_);
}

}  // namespace isorig::sim
