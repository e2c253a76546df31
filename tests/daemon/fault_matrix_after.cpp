#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/formatted.hpp"
#include "fault_matrix_rig.hpp"

/// MatrixRig: what is left to do and to look at once a fault is over.
namespace isorig::daemon::test {
namespace {

using Verb = Request::Verb;

}  // namespace

bool MatrixRig::come_back() {
  run_for(1.0);
  const auto state = [&] { return core().state(); };
  const auto must = [&](Verb verb, double target_mm = 0.0) {
    // "Try again in a moment" is an answer, too: a stop has to be confirmed, a stream to come back.
    Reply reply;
    const bool taken = run_until(15.0, [&] {
      reply = ask(verb, target_mm);
      if (!reply.accepted) run_for(0.1);
      return reply.accepted;
    });
    return taken || fail(std::string("refused for 15 s: ") + reply.text);
  };
  if (!core().status().zero_confirmed && !must(Verb::kConfirmZero)) return false;
  if (state() == RunState::kFaulted) {
    if (!must(Verb::kReset)) return false;
    if (state() == RunState::kPaused) {
      if (!must(Verb::kResume)) return false;
      run_for(1.0);
      if (state() != RunState::kRunning) return fail("did not go on after reset and resume");
    }
  }
  if (state() != RunState::kIdle && state() != RunState::kReady && state() != RunState::kSetup && !must(Verb::kAbort))
    return false;
  run_until(30.0, [&] { return state() == RunState::kReady || state() == RunState::kSetup; });
  if (state() == RunState::kSetup) {
    // A limit is still passed, or it was setup before: back inside, and out.
    if (std::abs(plant().truth().position_mm) > 4.0) {
      if (!must(Verb::kJog, 3.5)) return false;
      run_for(4.0);
    }
    if (!must(Verb::kLeaveSetup)) return false;
  }
  // And stays so: a device's clock may be measured anew for some seconds.
  if (!reach(RunState::kReady, 30.0)) return false;
  run_for(3.0);
  return reach(RunState::kReady, 30.0);
}

bool MatrixRig::start_again() {
  recorder_.reset();
  folder_.reset();
  core().set_recorder_fault("");  // as the host does when it has closed a run
  const double home_mm = plant().truth().position_mm;
  if (!begin("{ do = \"pressurize\", pressure_psi = 6, rate_psi_s = 8, settled_for_s = 0.2, timeout_s = 20 },\n"
             "{ do = \"ramp\", to_mm = 0.5, velocity_mm_s = 1 },\n"
             "{ do = \"hold\", duration_s = 100 },\n"))
    return false;
  const double countdown_s = config_.core.operating.arming_required ? config_.core.operating.countdown_s : 0.0;
  const bool works =
      run_until(10.0 + std::abs(home_mm) + countdown_s, [&] { return core().status().control.step == 2; });
  const auto t = plant().truth();
  if (!works || std::abs(t.position_mm - 0.5) > 0.02 || std::abs(t.pressure_psi - 6.0) > 0.2)
    return fail("a new start does not work");
  return true;
}

/// The files of the trip name the cause, and hold each sample of the second before it that the recording has.
bool MatrixRig::evidence_is_kept(const testing::Collected& got, const std::string& cause) {
  constexpr std::int64_t kLookedAtNs = 900'000'000;
  const auto wrong = [&](const std::string& what) {
    trouble_ = "evidence: " + what;
    return false;
  };
  const auto path = folder_->path() / "run" / "trip-1.json";
  if (!std::filesystem::exists(path)) return wrong("no trip-1.json");
  const auto trip = nlohmann::json::parse(testing::file_text(path));
  bool named = false;
  for (const auto& e : trip.at("events")) named = named || e.at("code") == cause;
  if (!named) return wrong("the chain of events has no " + cause);
  if (where_.at != At::kHeld && trip.at("code") != cause) return wrong("another cause: " + trip.at("code").dump());
  const auto trip_ns = trip.at("mono_ns").get<std::int64_t>();
  // By their numbers: samples of a device that stood and counts on are dated within a bound of seconds, and may lie
  // before the trip although they came long after it.
  std::size_t kept = 0, recorded = 0;
  std::int64_t last = 0;
  std::istringstream lines(testing::file_text(folder_->path() / "run" / "trip-1-frame.csv"));
  for (std::string line; std::getline(lines, line);) {
    long long ns = 0, device_us = 0, number = 0;
    if (std::sscanf(line.c_str(), "%*f,%lld,%*f,%lld,%lld", &ns, &device_us, &number) != 3) continue;  // its head
    if (ns <= trip_ns - kLookedAtNs || ns > trip_ns) continue;
    ++kept;
    last = std::max<std::int64_t>(last, number);
  }
  for (const auto& f : got.frames) {
    if (f.mono_ns > trip_ns - kLookedAtNs && f.mono_ns <= trip_ns && f.sequence <= last) ++recorded;
  }
  return kept == recorded || wrong(std::to_string(kept) + " samples for " + std::to_string(recorded));
}

/// What the devices made while the run was open is recorded, or counted as missing, and missing is what the fault
/// takes.
std::string MatrixRig::unaccounted(const RecorderStatus& told, const Losses& losses) const {
  // Read and not made while the run was open, and the other way round: a poll, what is on its way, and the sample of
  // this millisecond.
  constexpr double kEdgeOfFrame = 7.0, kEdgeOfPressure = 4.0;
  const auto judge = [](const char* what, std::uint64_t made, std::uint64_t recorded, std::uint64_t missing,
                        double edge, const Losses::OfStream& most) -> std::string {
    const double left = static_cast<double>(made) - static_cast<double>(recorded + missing);
    if (left >= -edge && left <= edge + most.unheard && static_cast<double>(missing) <= most.missing) return {};
    return base::formatted(
        "%s: %llu made, %llu recorded, %llu counted as missing; %.0f may be missing, %.0f unheard of", what,
        static_cast<unsigned long long>(made), static_cast<unsigned long long>(recorded),
        static_cast<unsigned long long>(missing), most.missing, most.unheard);
  };
  auto what = judge("frame", made_.frame(), told.frame_full + told.frame_averaged, told.frame_missing, kEdgeOfFrame,
                    losses.frame);
  if (!what.empty()) return what;
  return judge("pressure", made_.pressure(), told.pressure_full + told.pressure_averaged, told.pressure_missing,
               kEdgeOfPressure, losses.pressure);
}

/// Ends the recording, and reads it into `got`. `before`: what attempts before this one have left there.
bool MatrixRig::is_ended_in_order(testing::Collected& got, const Losses& losses, const testing::Collected& before) {
  recorder_->finish(rig_->streams, false);
  const auto told = recorder_->status();
  recorder_.reset();
  const auto report = messages::read_run(folder_->path() / "run", got);
  const auto wrong = [&](const std::string& what) {
    trouble_ = "recording: " + what;
    return false;
  };
  if (report.state() != messages::RecordingState::kIncomplete)
    return wrong(std::string(messages::to_text(report.state())) +
                 (report.complaints().empty() ? "" : ": " + report.complaints().front()));
  const auto averaged = [](const auto& intervals, std::size_t first) {
    std::uint64_t samples = 0;
    for (std::size_t i = first; i < intervals.size(); ++i) samples += static_cast<std::uint64_t>(intervals[i].samples);
    return samples;
  };
  if (got.frames.size() - before.frames.size() != told.frame_full ||
      averaged(got.frame_intervals, before.frame_intervals.size()) != told.frame_averaged)
    return wrong("other counts of the frame");
  if (got.pressures.size() - before.pressures.size() != told.pressure_full ||
      averaged(got.pressure_intervals, before.pressure_intervals.size()) != told.pressure_averaged)
    return wrong("other counts of the pressure");
  if (told.dropped_records + told.lost_messages != 0) return wrong("records were dropped");
  if (const auto what = unaccounted(told, losses); !what.empty()) return wrong(what);
  for (std::size_t i = 1; i < got.frames.size(); ++i) {
    if (got.frames[i].mono_ns <= got.frames[i - 1].mono_ns) return wrong("the frame's samples are out of order");
  }
  return true;
}

bool MatrixRig::recording_is_intact(const std::string& cause, const Losses& losses) {
  if (!recorder_) return true;
  run_for(3.0);
  testing::Collected got;
  if (!is_ended_in_order(got, losses, {})) return false;
  if (cause.empty()) return true;
  const auto at = trip_ns_;
  const auto wrong = [&](const std::string& what) {
    trouble_ = "recording: " + what;
    return false;
  };
  const auto is_cause = [&](const isorig_msgs::event_t& e) { return e.code == cause; };
  if (std::none_of(got.events.begin(), got.events.end(), is_cause)) return wrong("no event " + cause);
  if (!evidence_is_kept(got, cause)) return false;
  if (at < 0) return true;
  for (const auto* intervals : {&got.frame_intervals, &got.pressure_intervals}) {
    for (const auto& i : *intervals) {
      if (i.last_ns > at - 900'000'000 && i.first_ns < at + 1'900'000'000) return wrong("the evidence is averaged");
    }
  }
  return true;
}

}  // namespace isorig::daemon::test
