#include "soaked_rig.hpp"

#include <cmath>

namespace isorig::soak {
namespace {

using daemon::RunState;
using Verb = daemon::Request::Verb;

constexpr std::int64_t kHostTurnNs = 50'000'000;  // as `isorig run`
// 2026-01-01T00:00:00Z: a recording in virtual time does not know when it was made.
constexpr std::int64_t kEpochUnixUs = 1'767'225'600'000'000;

}  // namespace

SoakedRig::SoakedRig(const daemon::RigConfig& config, const std::filesystem::path& runs_root)
    : config_(config), rig_(std::make_unique<daemon::VirtualRig>(config)), witness_(config) {
  daemon::Host::Options options;
  options.runs_root = runs_root;
  options.virtual_time = true;
  options.epoch_unix_us = [] { return kEpochUnixUs; };
  options.seed = static_cast<std::int64_t>(config.sim->seed);
  options.revision = "soak";
  options.breathe = [this] { tick(); };
  options.free_bytes = [this](const std::filesystem::path&) {
    return disk_full ? std::uint64_t{0} : std::uint64_t{1} << 40U;
  };
  host_ = std::make_unique<daemon::Host>(config, rig_->core(), rig_->streams, options);
}

void SoakedRig::tick() {
  if (late_ns != 0) {
    const auto late = late_ns;
    late_ns = 0;
    rig_->core().tick(rig_->now_ns() + 1, late, 0);
  }
  rig_->tick();
  witness_.look(*rig_);
  made_.look(*rig_, was_open_);
  frame.made = made_.frame();
  pressure.made = made_.pressure();
  if (rig_->now_ns() % kHostTurnNs != 0 || disk_hangs) return;
  host_->turn(rig_->now_ns());
  follow_run();
}

void SoakedRig::follow_run() {
  const bool open = host_->run_open();
  if (was_open_ && !open) add_counts();
  was_open_ = open;
}

void SoakedRig::add_counts() {
  const auto s = host_->recorder_status();
  frame.full += s.frame_full;
  frame.averaged += s.frame_averaged;
  frame.missing += s.frame_missing;
  pressure.full += s.pressure_full;
  pressure.averaged += s.pressure_averaged;
  pressure.missing += s.pressure_missing;
  dropped += s.dropped_records;
  lost_messages += s.lost_messages;
}

void SoakedRig::run_for(double seconds) {
  const auto until_ns = rig_->now_ns() + static_cast<std::int64_t>(seconds * 1e9);
  while (rig_->now_ns() < until_ns) tick();
}

daemon::Host::Result SoakedRig::ask(Verb verb, double target_mm) {
  daemon::Request request;
  request.verb = verb;
  request.target_mm = target_mm;
  const auto number = host_->submit(request);
  if (number == 0) return {false, "the loop takes no requests", {}};
  std::optional<daemon::Host::Result> answer;
  run_until(2.0, [&] { return (answer = host_->answer_to(number)).has_value(); });
  return answer ? *answer : daemon::Host::Result{false, "the loop did not answer within 2 s", {}};
}

bool SoakedRig::begin(const daemon::StartOptions& options) {
  const auto result = host_->start(options);
  refusal_ = result.text;
  if (!result.ok) return false;
  ++attempts;
  run_id = result.run;
  was_open_ = true;
  return true;
}

bool SoakedRig::start(const std::string& protocol_text) {
  daemon::StartOptions options;
  options.protocol_text = protocol_text;
  options.protocol_name = "soak.toml";
  return begin(options);
}

bool SoakedRig::resume(const std::string& run) {
  daemon::StartOptions options;
  options.resume_run = run;
  if (!begin(options)) return false;
  ++runs_resumed;
  return true;
}

bool SoakedRig::come_back(double seconds) {
  const double until_s = now_s() + seconds;
  const auto refused = [&](const char* what, const daemon::Host::Result& result) {
    if (!result.ok) refusal_ = std::string(what) + ": " + result.text;
    return !result.ok;
  };
  double running_since_s = -1.0;
  while (now_s() < until_s) {
    run_for(0.1);
    if (is_done()) return true;
    const auto now = state();
    if (now != RunState::kRunning) running_since_s = -1.0;
    if (!status().zero_confirmed && now != RunState::kRunning) refused("confirm-zero", ask(Verb::kConfirmZero));
    switch (now) {
      case RunState::kFaulted:
        if (!refused("reset", ask(Verb::kReset))) ++resets;
        break;
      case RunState::kPaused:
        if (!refused("resume", ask(Verb::kResume))) ++held_resumed;
        break;
      case RunState::kRunning:
        // And goes on: what was repaired may show itself.
        if (running_since_s < 0.0) running_since_s = now_s();
        if (now_s() - running_since_s > 3.0) return true;
        break;
      case RunState::kReady:
        if (!host_->run_open()) resume(run_id);
        break;
      case RunState::kSetup:
        // A limit is still passed: back inside, and out.
        refused("jog", ask(Verb::kJog, std::copysign(3.5, rig_->rig().truth().position_mm)));
        run_for(4.0);
        refused("setup --off", ask(Verb::kLeaveSetup));
        break;
      default:
        refusal_ = std::string(to_text(now)) + ": " + status().not_ready;
        break;
    }
  }
  return false;
}

}  // namespace isorig::soak
