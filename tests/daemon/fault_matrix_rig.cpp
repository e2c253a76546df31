#include "fault_matrix_rig.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "tree.hpp"

namespace isorig::daemon::test {
namespace {

using Verb = Request::Verb;

constexpr std::int64_t kDrainNs = 20'000'000;
constexpr std::int64_t kSetpointNs = 10'000'000;  // the loop's record of it is no newer

const Situation kAll[kSituations] = {
    {At::kReady, "ready", "between runs, vented, at rest", 0.0, false, false},
    {At::kArmed, "armed", "the first of two acts was given", 0.0, false, false},
    {At::kCountdown, "countdown", "both acts were given; nothing moves yet", 0.0, true, false},
    {At::kSetup, "setup", "setup, at rest", 0.0, false, false},
    {At::kJog, "jog", "setup, jogged at 1 mm/s; faults of a segment strike just before the jog", 1.0, false, false},
    {At::kApproach, "approach",
     "to the first step's position at 1 mm/s, vented; faults of a segment strike just before the start", 1.0, true,
     false},
    {At::kFill, "fill", "`pressurize` upwards, 1 psi/s, at 5 psi", 0.0, true, true},
    {At::kLower, "lower", "`pressurize` downwards, 0.5 psi/s, at 11 psi", 0.0, true, true},
    {At::kSettle, "settle", "`settle` at 10 psi: rest until the force stands", 0.0, true, true},
    {At::kHold, "hold", "`hold` at 10 psi, after a ramp", 0.0, true, true},
    {At::kSlow, "slow ramp", "`ramp` at 0.1 mm/s and 10 psi", 0.1, true, true},
    {At::kFast, "fast ramp", "`ramp` at 5 mm/s and 10 psi", 5.0, true, true},
    {At::kTriangle, "triangle", "`wave` of triangles, 2 mm/s, 10 psi", 2.0, true, true},
    {At::kSine, "sine", "`wave` of sines, at most 2 mm/s, 10 psi", 2.0, true, true},
    {At::kPaused, "paused", "paused in a ramp; the loop holds 10 psi", 0.0, true, true},
    {At::kSealed, "sealed", "paused and sealed at 10 psi: both valves shut", 0.0, true, true},
    {At::kHeld, "held", "held at 10 psi by a program stop before (`loop.late`)", 0.0, true, true},
    {At::kStopping, "stopping", "aborted 0.05 s before: the vent is open, some pressure is left", 0.0, true, true},
};

constexpr const char* kTo10 =
    "{ do = \"pressurize\", pressure_psi = 10, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },\n";

std::string ramps(const char* stroke_mm, const char* speed_mm_s) {
  std::string all = kTo10;
  for (int i = 0; i < 30; ++i) {
    all += std::string("{ do = \"ramp\", to_mm = ") + (i % 2 == 0 ? "" : "-") + stroke_mm +
           ", velocity_mm_s = " + speed_mm_s + " },\n";
  }
  return all;
}

std::string steps_of(At at) {
  const std::string to10 = kTo10;
  switch (at) {
    case At::kFill:
      return "{ do = \"pressurize\", pressure_psi = 12, rate_psi_s = 1, settled_for_s = 60, timeout_s = 200 },\n";
    case At::kLower:
      return "{ do = \"pressurize\", pressure_psi = 12, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },\n"
             "{ do = \"pressurize\", pressure_psi = 4, rate_psi_s = 0.5, settled_for_s = 60, timeout_s = 200 },\n";
    case At::kSettle:
      return to10 +
             "{ do = \"settle\", force_slope_N_s = 1e-9, window_s = 2, settled_for_s = 2, expected_s = 5, timeout_s = "
             "200, on_timeout = \"continue\" },\n";
    case At::kHold:
      return to10 + "{ do = \"ramp\", to_mm = 0.5, velocity_mm_s = 5 },\n{ do = \"hold\", duration_s = 1000 },\n";
    case At::kSlow:
      return ramps("0.15", "0.1");
    case At::kFast:
      return ramps("2", "5");
    case At::kTriangle:
      return to10 + "{ do = \"wave\", shape = \"triangle\", amplitude_mm = 2, velocity_mm_s = 2, cycles = 50 },\n";
    case At::kSine:
      return to10 + "{ do = \"wave\", shape = \"sine\", amplitude_mm = 2, velocity_mm_s = 2, cycles = 50 },\n";
    case At::kPaused:
    case At::kSealed:
      return ramps("2", "1");
    default:
      return to10 + "{ do = \"hold\", duration_s = 1000 },\n";
  }
}

protocol::Plan compiled(const std::string& steps, const protocol::Limits& limits) {
  return protocol::compile(
      base::TomlDocument::parse_text("format = \"isorig-protocol/1\"\nname = \"matrix\"\napproach_velocity_mm_s = 1.0\n"
                                     "recording.policy = \"round_ramps\"\nsteps = [\n" +
                                         steps + "]\n",
                                     "matrix.toml"),
      limits);
}

/// In memory where there is such a place: hundreds of recordings are made.
std::filesystem::path scratch() {
  std::error_code ignored;
  const std::filesystem::path memory = "/dev/shm";
  return std::filesystem::is_directory(memory, ignored) && ::access(memory.c_str(), W_OK) == 0 ? memory : "/tmp";
}

double seconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-9;
}

}  // namespace

const Situation& situation(At at) {
  return kAll[static_cast<unsigned>(at)];
}

MatrixRig::MatrixRig(At at)
    : where_(situation(at)), config_(load_rig(isorig::test::source_path() + "/config/rigs/sim.toml")) {
  config_.core.operating.arming_required = at == At::kArmed || at == At::kCountdown;
  // A cell is watched for 13.1 s at most, and has to be in its countdown until then.
  config_.core.operating.countdown_s = at == At::kCountdown ? 16.0 : 2.0;
  config_.core.operating.arm_window_s = 30.0;
  config_.sim->pneumatics.supply_volume_mL = 10.0;  // a short hose: an empty supply shows within seconds
  rig_ = std::make_unique<VirtualRig>(config_);
}

bool MatrixRig::fail(const std::string& what) {
  const auto s = core().status();
  trouble_ = what + " (" + to_text(core().state()) + ", fault \"" + s.fault + "\", not ready: \"" + s.not_ready + "\")";
  return false;
}

void MatrixRig::tick() {
  if (late_ns != 0) {
    core().tick(rig_->now_ns() + 1, late_ns, 0);
    late_ns = 0;
  }
  rig_->tick();
  made_.look(*rig_, recorder_ != nullptr);
  if (rig_->now_ns() % kSetpointNs == 0) follow_setpoint();
  look();
  if (rig_->now_ns() % kDrainNs == 0) drain();
}

/// By the ramp that the step in force asks for.
void MatrixRig::follow_setpoint() {
  const auto now = core().loop_status();
  double rises_psi_s = config_.core.pressure_loop.rate_limit_psi_s;
  if (const auto step = now.control.step; step < plan_.steps.size() && plan_.steps[step].rate_psi_s > 0.0)
    rises_psi_s = std::min(rises_psi_s, plan_.steps[step].rate_psi_s);
  ceiling_.follow(now, rises_psi_s, seconds(kSetpointNs));
}

/// The plant's truth, every millisecond.
void MatrixRig::look() {
  const auto now_ns = rig_->now_ns();
  const auto state = core().state();
  if (strike_ns_ < 0) return;
  const auto t = plant().truth();
  if (state == RunState::kFaulted && last_state_ != RunState::kFaulted && trip_ns_ < 0) {
    trip_ns_ = now_ns;
    seen_.tripped_psi = t.pressure_psi;
    seen_.moved_at_trip = std::abs(t.velocity_mm_s) > kMoving_mm_s;
  }
  last_state_ = state;
  if (std::abs(t.velocity_mm_s) > kMoving_mm_s) moved_ns_ = now_ns;
  if (t.pressure_psi > rest_psi_) pressed_ns_ = now_ns;
  seen_.position_min_mm = std::min(seen_.position_min_mm, t.position_mm);
  seen_.position_max_mm = std::max(seen_.position_max_mm, t.position_mm);
  seen_.force_min_N = std::min(seen_.force_min_N, t.force_N);
  seen_.force_max_N = std::max(seen_.force_max_N, t.force_N);
  seen_.pressure_max_psi = std::max(seen_.pressure_max_psi, t.pressure_psi);
  seen_.over_setpoint_psi = std::max(seen_.over_setpoint_psi, t.pressure_psi - ceiling_.psi());
}

void MatrixRig::drain() {
  EventRecord e;
  while (core().host_events.pop(e)) {
    if (strike_ns_ >= 0) events_.push_back(e);
  }
  if (recorder_) {
    if (disk_hangs) return;
    recorder_->drain(rig_->streams, rig_->now_ns());
    const auto status = recorder_->status();
    // As the host has it.
    const bool bad = status.disk >= DiskCondition::kLow || !status.fault.empty();
    core().set_recorder_fault(bad ? std::string(describe(status.disk)) + " " + status.fault : std::string());
    core().recorder_turn(rig_->now_ns());
    return;
  }
  FrameRecord f;
  PressureRecord p;
  ControlRecord c;
  ExchangeRecord x;
  SyncRecord s;
  while (rig_->streams.frame.pop(f)) {
  }
  while (rig_->streams.pressure.pop(p)) {
  }
  while (rig_->streams.control.pop(c)) {
  }
  while (rig_->streams.events.pop(e)) {
  }
  while (rig_->streams.exchanges.pop(x)) {
  }
  while (rig_->streams.sync.pop(s)) {
  }
}

void MatrixRig::run_for(double seconds_to_go) {
  const auto until = rig_->now_ns() + static_cast<std::int64_t>(seconds_to_go * 1e9);
  while (rig_->now_ns() < until) tick();
  drain();
}

Reply MatrixRig::ask(Verb verb, double target_mm) {
  Request request;
  request.verb = verb;
  request.id = ++last_id_;
  request.plan = &plan_;
  request.target_mm = target_mm;
  core().requests.push(request);
  tick();
  Reply reply;
  while (core().replies.pop(reply) && reply.id != request.id) {
  }
  return reply;
}

bool MatrixRig::reach(RunState state, double within_s) {
  return run_until(within_s, [&] { return core().state() == state; }) ||
         fail(std::string("did not become ") + to_text(state));
}

void MatrixRig::open_recording() {
  if (!folder_) {
    folder_ = std::make_unique<testing::TemporaryDirectory>("matrix", scratch());
    opened_s_ = now_s();
  }
  auto options = testing::recorder_options(folder_->path() / "run");
  options.before_s = plan_.recording.before_s;
  options.dropped_before = rig_->streams.dropped();
  options.free_bytes = [this](const std::filesystem::path&) {
    return disk_full ? std::uint64_t{0} : std::uint64_t{1} << 40U;
  };
  auto info = testing::run_info();
  info.start_mono_ns = rig_->now_ns();
  recorder_ = std::make_unique<Recorder>(options, info);
}

bool MatrixRig::arm(const std::string& steps) {
  if (!steps.empty()) plan_ = compiled(steps, config_.limits);
  if (!reach(RunState::kReady, 30.0)) return false;
  drain();
  if (!config_.core.operating.arming_required) return true;
  const auto reply = ask(Verb::kArm);
  return reply.accepted || fail(std::string("not armed: ") + reply.text);
}

bool MatrixRig::begin(const std::string& steps) {
  folder_.reset();
  return arm(steps) && give_start();
}

bool MatrixRig::begin_again() {
  return arm({}) && give_start();
}

bool MatrixRig::give_start() {
  open_recording();
  if (config_.core.operating.arming_required) {
    const auto reply = ask(Verb::kGo);
    return reply.accepted || fail(std::string("no countdown: ") + reply.text);
  }
  const auto reply = ask(Verb::kStart);
  return reply.accepted || fail(std::string("did not start: ") + reply.text);
}

bool MatrixRig::set_off() {
  if (where_.at == At::kApproach) return begin(steps_of(where_.at));
  const auto reply = ask(Verb::kJog, 3.0);
  return reply.accepted || fail(reply.text);
}

bool MatrixRig::bring(bool before_motion) {
  const auto position_mm = [&] { return plant().truth().position_mm; };
  const auto pressure_psi = [&] { return plant().truth().pressure_psi; };
  const auto in_step = [&](std::uint32_t step) {
    return run_until(30.0, [&] { return core().status().control.step == step; }) || fail("the step did not begin");
  };
  if (!reach(RunState::kReady, 5.0)) return false;
  run_for(1.0);
  switch (where_.at) {
    case At::kReady:
      return true;
    case At::kArmed:
    case At::kCountdown:
      if (!(where_.at == At::kArmed ? arm(steps_of(where_.at)) : begin(steps_of(where_.at)))) return false;
      run_for(0.5);
      return true;
    case At::kSetup:
    case At::kJog:
      if (const auto reply = ask(Verb::kSetup); !reply.accepted) return fail(reply.text);
      run_for(0.6);
      if (where_.at == At::kSetup || before_motion) return true;
      if (!set_off()) return false;
      return run_until(5.0, [&] { return position_mm() > 0.5; }) || fail("the jog does not move");
    case At::kApproach:
      plant().frame().start_segment({900, 3.0F, 2.0F});  // at its own panel
      if (!run_until(10.0, [&] { return position_mm() > 2.99; })) return fail("the panel does not move it");
      run_for(1.0);
      if (before_motion) return true;
      if (!set_off()) return false;
      return run_until(5.0, [&] { return position_mm() < 2.5; }) || fail("no approach");
    default:
      break;
  }
  if (!begin(steps_of(where_.at))) return false;
  switch (where_.at) {
    case At::kFill:
      return run_until(20.0, [&] { return pressure_psi() > 5.0; }) || fail("does not fill");
    case At::kLower:
      return in_step(1) && (run_until(20.0, [&] { return pressure_psi() < 11.0; }) || fail("does not vent"));
    case At::kSlow:
      return in_step(1) && (run_until(20.0, [&] { return position_mm() > 0.1; }) || fail("does not move"));
    case At::kFast:
    case At::kTriangle:
    case At::kSine:
    case At::kPaused:
    case At::kSealed:
      if (!in_step(1) || !run_until(20.0, [&] { return position_mm() > 0.5; })) return fail("does not move");
      break;
    default:
      if (!in_step(where_.at == At::kHold ? 2 : 1)) return false;
      run_for(1.0);
      break;
  }
  if (where_.at == At::kPaused || where_.at == At::kSealed) {
    if (const auto reply = ask(Verb::kPause); !reply.accepted) return fail(reply.text);
    run_for(1.0);
    if (where_.at == At::kSealed) {
      if (const auto reply = ask(Verb::kSeal); !reply.accepted) return fail(reply.text);
      run_for(0.5);
    }
  } else if (where_.at == At::kHeld) {
    late_ns = 400'000'000;
    run_for(1.0);
    if (core().state() != RunState::kFaulted) return fail("is not held");
  } else if (where_.at == At::kStopping) {
    if (const auto reply = ask(Verb::kAbort); !reply.accepted) return fail(reply.text);
    run_for(0.05);
  }
  return true;
}

void MatrixRig::strike(double rest_psi) {
  drain();
  rest_psi_ = rest_psi;
  strike_ns_ = moved_ns_ = pressed_ns_ = rig_->now_ns();
  const auto t = plant().truth();
  last_state_ = core().state();
  seen_.position_min_mm = seen_.position_max_mm = seen_.began_mm = t.position_mm;
  seen_.force_min_N = seen_.force_max_N = t.force_N;
  seen_.pressure_max_psi = t.pressure_psi;
}

void MatrixRig::watch(double for_s) {
  run_for(for_s);
  seen_.watched_s = seconds(rig_->now_ns() - strike_ns_);
}

Seen MatrixRig::seen() const {
  Seen s = seen_;
  s.stood_s = seconds(moved_ns_ - strike_ns_);
  s.vented_s = seconds(pressed_ns_ - strike_ns_);
  const auto status = rig_->core().status();
  s.not_ready = status.not_ready;
  s.state = rig_->core().state();
  for (std::uint32_t i = 0; i < status.fault_count; ++i) {
    if (status.faults[i].mono_ns < strike_ns_) continue;
    s.faults.emplace_back(status.faults[i].code);
    if (s.faults.size() == 1) s.trip_s = seconds(status.faults[i].mono_ns - strike_ns_);
  }
  if (!s.faults.empty()) s.cause = s.faults.front();
  for (const auto& e : events_) s.events.emplace_back(e.code);
  return s;
}

}  // namespace isorig::daemon::test
