#include "play.hpp"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <optional>
#include <set>
#include <string_view>

#include "base/formatted.hpp"
#include "base/text_file.hpp"
#include "base/toml_reader.hpp"
#include "daemon/core/trips.hpp"
#include "daemon/recording/catalogue.hpp"
#include "messages/run_log.hpp"
#include "protocol/compile.hpp"
#include "schedule.hpp"
#include "soaked_rig.hpp"

namespace isorig::soak {
namespace {

using daemon::RunState;
using daemon::test::At;
using daemon::test::Expected;
using daemon::test::Fault;
using nlohmann::ordered_json;
using Kind = Expected::Kind;

constexpr double kMostStep_s = 86'400.0;  // of waiting for a step: the run is longer than that in no case
constexpr double kMostRecovery_s = 900.0;
constexpr double kTick_s = 0.005;
constexpr double kMostGrowth_MB = 12.0;

bool is_one_of(std::string_view name, std::initializer_list<std::string_view> list) {
  return std::find(list.begin(), list.end(), name) != list.end();
}

/// Every code that the matrix has for a fault, whatever the rig does.
std::set<std::string> codes_of(const Fault& fault) {
  std::set<std::string> all;
  for (unsigned i = 0; i < daemon::test::kSituations; ++i) {
    const auto& e = daemon::test::expected(fault, static_cast<At>(i));
    if (e.kind == Kind::kTrips) all.insert(e.codes.begin(), e.codes.end());
  }
  return all;
}

/// The codes under which a segment that a fault has spoilt may end, for as long as the segment lasts: those of all
/// faults of the frame's motion. How a spoilt segment shows depends on its length and its speed.
std::set<std::string> late_codes_of(const Fault& fault) {
  constexpr std::string_view kMotion = "The frame's motion";
  std::set<std::string> all;
  if (fault.group != kMotion) return all;
  for (const Fault& each : daemon::test::faults())
    if (each.group == kMotion) all.merge(codes_of(each));
  return all;
}

/// What is found by an age or a word of a device, and so within the same time at every pressure and speed. What a
/// motion or the air has to show takes as long as the motion.
bool has_its_time(const Fault& fault) {
  return !is_one_of(fault.group, {"The frame's motion", "The stop", "Valves, hoses, supply"}) &&
         !is_one_of(fault.name, {"SensorStuck", "TubeOff", "TubeBlocked", "TubeKinked", "ReadsLow", "SensorDrifts",
                                 "FrameFiveLost", "DiskFull", "DiskHangs"});
}

/// While it is there samples are not made, or do not arrive before the run is over: no later number shows the gap.
bool silences_frame(const Fault& fault) {
  return is_one_of(fault.group, {"The frame's link (Modbus, ASCII lines)"}) || is_one_of(fault.name, {"FrameRestarts"});
}
bool silences_pressure(const Fault& fault) {
  return is_one_of(fault.group, {"The Teensy's link"}) || is_one_of(fault.name, {"SensorFrozen"});
}

bool lies(const Fault& fault) {
  return is_one_of(fault.group, {"Pressure sensor and its tube", "Valves, hoses, supply"});
}

struct Counts : messages::RunVisitor {
  void frame(const isorig_msgs::frame_batch_t& m) override { frame_full += static_cast<std::uint64_t>(m.count); }
  void pressure(const isorig_msgs::pressure_batch_t& m) override {
    pressure_full += static_cast<std::uint64_t>(m.count);
  }
  void frame_average(const isorig_msgs::frame_average_batch_t& m) override {
    for (int i = 0; i < m.count; ++i) frame_averaged += static_cast<std::uint64_t>(m.samples[i]);
  }
  void pressure_average(const isorig_msgs::pressure_average_batch_t& m) override {
    for (int i = 0; i < m.count; ++i) pressure_averaged += static_cast<std::uint64_t>(m.samples[i]);
  }
  std::uint64_t frame_full = 0, frame_averaged = 0, pressure_full = 0, pressure_averaged = 0;
};

class Play {
 public:
  Play(std::uint64_t seed, const PlayOptions& options)
      : options_(options), config_(daemon::load_rig(options.rig)), protocol_(base::read_config_file(options.protocol)) {
    config_.core.operating.arming_required = false;   // ArmingTest and the fault matrix have the two acts
    config_.sim->pneumatics.supply_volume_mL = 10.0;  // as the fault matrix: an empty supply shows within seconds
    config_.sim->seed = seed;
    // As on a real rig: how long a full disk is not noticed follows from it.
    config_.recording.virtual_sync_interval_s = config_.recording.sync_interval_s;
    plan_ = protocol::compile(base::TomlDocument::parse_text(protocol_, "soak.toml"), config_.limits);
    strikes_ = draw(plan_, seed, options.faults);
    out_["seed"] = seed;
    out_["strikes"] = ordered_json::array();
  }

  ordered_json run() {
    SoakedRig rig(config_, options_.runs_root);
    if (!rig.run_until(30.0, [&] { return rig.state() == RunState::kReady; }) || !rig.start(protocol_)) {
      find("the rig did not start: " + rig.refusal());
      return finish(rig);
    }
    rig.run_for(60.0);  // what is allocated once has been
    out_["begin"] = {{"MB", resident_MB()}, {"descriptors", open_descriptors()}};
    for (const auto& strike : strikes_) {
      if (!await(rig, strike)) break;
      strike_once(rig, strike);
      if (rig.is_done()) break;
    }
    // What is left of it, undisturbed.
    double most_MB = 0.0;
    while (!rig.is_done() && (rig.state() == RunState::kRunning || recovered_late(rig))) {
      rig.run_for(10.0);
      most_MB = std::max(most_MB, resident_MB());
    }
    rig.run_until(60.0, [&] { return !rig.host().run_open(); });
    for (const auto& each : rig.witness().take_breaches()) find("undisturbed: " + each);
    out_["end"] = {{"MB", resident_MB()}, {"descriptors", open_descriptors()}};
    return finish(rig);
  }

 private:
  void find(const std::string& what) { findings_.push_back(what); }

  /// To the moment of the strike. False: the run ended before.
  bool await(SoakedRig& rig, const Strike& strike) {
    const auto step = [&] { return rig.status().control.step; };
    const double until_s = rig.now_s() + kMostStep_s;
    while (step() != strike.step) {
      if (step() > strike.step && rig.state() == RunState::kRunning) return true;  // a strike before took its time
      if (recovered_late(rig)) continue;
      if (rig.now_s() > until_s || rig.state() != RunState::kRunning) {
        if (!rig.is_done())
          find(base::formatted("waiting for step %u: %s, %s", strike.step, to_text(rig.state()), rig.status().fault));
        return false;
      }
      // Steps of a fraction of a second are among them.
      rig.run_for(step() + 1 >= strike.step ? 0.01 : 0.2);
    }
    rig.run_for(strike.after_s);
    return rig.state() == RunState::kRunning || recovered_late(rig);
  }

  /// A segment that was commanded under a fault is not as it ought to be when the fault has been repaired: a slow ramp
  /// that the frame ignores is found when the crosshead should have gone some millimetres, minutes later. Once for each
  /// strike, under a code of its own and before a next segment could have gone right, the operator comes again.
  bool recovered_late(SoakedRig& rig) {
    if (rig.state() != RunState::kFaulted || late_codes_.empty()) return false;
    const auto now = rig.status();
    std::string cause;
    for (std::uint32_t i = 0; i < now.fault_count && cause.empty(); ++i)
      if (static_cast<double>(now.faults[i].mono_ns) * 1e-9 >= repaired_s_) cause = now.faults[i].code;
    const bool follows = late_codes_.contains(cause) && now.control.step <= late_until_step_;
    late_codes_.clear();
    if (!follows) return false;
    out_["strikes"].back()["late"] = cause;
    out_["strikes"].back()["late_s"] = rig.now_s() - repaired_s_;
    if (!rig.come_back(kMostRecovery_s)) find("late " + cause + " did not come back: " + rig.refusal());
    return rig.state() == RunState::kRunning;
  }

  void strike_once(SoakedRig& rig, const Strike& strike) {
    const auto faults = daemon::test::faults();
    const Fault& fault = faults[strike.fault];
    const Fault* second = strike.second ? &faults[*strike.second] : nullptr;
    auto& witness = rig.witness();
    for (const auto& each : witness.take_breaches()) find("undisturbed: " + each);
    const auto step = rig.status().control.step;
    const At at = situation_of(plan_, std::min(step, static_cast<std::uint32_t>(plan_.steps.size() - 1)));
    const auto& expected = daemon::test::expected(fault, at);
    auto bounds = daemon::test::bounds(fault, expected);
    const double struck_s = rig.now_s();
    witness.set_reading_lies(lies(fault) || (second != nullptr && lies(*second)));
    witness.strike(rig.rig());
    fault.set(rig, true);
    if (fault.then) {
      rig.run_for(0.02);
      rig.ask(*fault.then);
    }
    // What lasts for a moment is over by itself, whatever strikes meanwhile.
    const auto run_to = [&](double until_s) { rig.run_for(struck_s + until_s - rig.now_s()); };
    std::vector<std::pair<double, std::function<void()>>> then;
    if (fault.lasts_s > 0.0) then.emplace_back(fault.lasts_s, [&] { fault.set(rig, false); });
    if (second != nullptr) {
      then.emplace_back(strike.second_after_s, [&] { second->set(rig, true); });
      if (second->lasts_s > 0.0)
        then.emplace_back(strike.second_after_s + second->lasts_s, [&] { second->set(rig, false); });
    }
    std::sort(then.begin(), then.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (const auto& [at_s, act] : then) {
      run_to(at_s);
      act();
    }
    rig.run_until(strike.watch_s, [&] { return witness.trip_s() >= 0.0; });
    // A disk that hangs is tripped over after 2 s; the queues of virtual time hold 16 s of samples.
    rig.run_for(rig.disk_hangs ? 3.0 : std::max(strike.stay_s, bounds.vents_s + 1.0));

    ordered_json s;
    s["fault"] = fault.name;
    if (second != nullptr) s["second"] = second->name;
    s["at_s"] = struck_s;
    s["step"] = step;
    s["in"] = daemon::test::situation(at).name;
    s["psi"] = std::round(witness.began_psi() * 100.0) / 100.0;
    const auto now = rig.status();
    std::string cause;
    for (std::uint32_t i = 0; i < now.fault_count && cause.empty(); ++i) {
      if (static_cast<double>(now.faults[i].mono_ns) * 1e-9 >= struck_s) cause = now.faults[i].code;
    }
    s["cause"] = cause;
    s["found_s"] = witness.trip_s();
    s["stood_s"] = witness.stood_s();
    if (now.vented_fault && !cause.empty()) s["vented_s"] = witness.vented_s(bounds.rest_psi);
    judge(fault, second, at, cause, now, rig, bounds);

    // Repaired, and gone on with.
    fault.set(rig, false);
    if (second != nullptr) second->set(rig, false);
    rig.late_ns = 0;
    const double repaired_s = repaired_s_ = rig.now_s();
    const auto stepped = rig.status().control.step;
    const auto silent_s = [&](bool (*silences)(const Fault&)) {
      return silences(fault) || (second != nullptr && silences(*second)) ? repaired_s - struck_s + 1.0 : 0.0;
    };
    frame_silent_s_ += silent_s(silences_frame);
    pressure_silent_s_ += silent_s(silences_pressure);
    if (!rig.come_back(kMostRecovery_s)) find(where(fault, second, at) + "did not come back: " + rig.refusal());
    s["back_s"] = rig.now_s() - repaired_s;
    for (const auto& each : witness.take_breaches()) find(where(fault, second, at) + each);
    witness.set_reading_lies(false);
    late_codes_ = late_codes_of(fault);
    if (second != nullptr) late_codes_.merge(late_codes_of(*second));
    late_until_step_ = stepped + 1;
    out_["strikes"].push_back(std::move(s));
  }

  [[nodiscard]] static std::string where(const Fault& fault, const Fault* second, At at) {
    return std::string(fault.name) + (second != nullptr ? std::string(" and ") + second->name : "") + " in " +
           daemon::test::situation(at).name + ": ";
  }

  void judge(const Fault& fault, const Fault* second, At at, const std::string& cause, const daemon::Status& now,
             SoakedRig& rig, const daemon::test::Bounds& bounds) {
    const auto& e = daemon::test::expected(fault, at);
    auto& witness = rig.witness();
    const auto here = where(fault, second, at);
    auto codes = codes_of(fault);
    if (second != nullptr) codes.merge(codes_of(*second));
    // Which of the guard's sums is the first to fill depends on pressure, speed and moment.
    const bool guarded = (lies(fault) || (second != nullptr && lies(*second))) &&
                         (cause.starts_with("pressure.") || cause.starts_with("teensy."));
    if (!cause.empty() && !guarded && !codes.contains(cause)) find(here + "called " + cause);
    if (second != nullptr) return;  // of two faults at once the witness' bounds are asked for, and the way back
    const bool moved = std::abs(witness.began_mm_s()) > 1e-3;
    const bool must =
        e.kind == Kind::kTrips && (has_its_time(fault) || (fault.name == std::string_view("FrameFiveLost") && moved));
    if (must && cause.empty()) find(here + "not found");
    if (must && witness.trip_s() > e.within_s + kTick_s)
      find(here + base::formatted("found after %.3f s, bound %.3f s", witness.trip_s(), e.within_s));
    if (e.kind == Kind::kRides && fault.group != std::string_view("The stop") && !cause.empty())
      find(here + "tripped, though it is to be ridden out: " + cause);
    if (cause.empty()) return;
    if (now.control.state != RunState::kFaulted)
      find(here + std::string("named ") + cause + ", and is " + to_text(now.control.state));
    // From the trip, or by the frame's own watchdog.
    const double stands_s = std::max(witness.trip_s() + 0.3, 0.84);
    if (witness.stood_s() > stands_s)
      find(here + base::formatted("stood after %.3f s, bound %.3f s", witness.stood_s(), stands_s));
    const auto phase = witness.moved_at_trip() ? daemon::Phase::kMoving : daemon::Phase::kHolding;
    bool safe = false, safe_in_other = false;
    for (std::uint32_t i = 0; i < now.fault_count; ++i) {
      safe = safe || daemon::severity_of(now.faults[i].code, phase) == daemon::Severity::kSafeState;
      safe_in_other = safe_in_other ||
                      daemon::severity_of(now.faults[i].code, daemon::Phase::kHolding) == daemon::Severity::kSafeState;
    }
    // The crosshead stands soon after a trip: what comes on top is judged at rest.
    if (now.vented_fault != safe && now.vented_fault != safe_in_other) find(here + "not the severity of " + cause);
    if (now.vented_fault && witness.vented_s(bounds.rest_psi) > witness.trip_s() + bounds.vents_s)
      find(here + base::formatted("vented after %.3f s, bound %.3f s", witness.vented_s(bounds.rest_psi),
                                  witness.trip_s() + bounds.vents_s));
    if (!now.vented_fault && !lies(fault) && rig.plant().truth().pressure_psi < 0.85 * witness.began_psi() - 0.1)
      find(here +
           base::formatted("a program stop let the pressure fall to %.2f psi", rig.plant().truth().pressure_psi));
  }

  /// The recording: whole, and every sample that the plant made is in it or counted.
  ordered_json finish(SoakedRig& rig) {
    const auto& e = rig.witness().extremes();
    out_["rig_s"] = rig.now_s();
    out_["attempts"] = rig.attempts;
    out_["resets"] = rig.resets;
    out_["held_resumed"] = rig.held_resumed;
    out_["runs_resumed"] = rig.runs_resumed;
    out_["extremes"] = {{"over_setpoint_psi", e.over_setpoint_psi},
                        {"pressure_psi", e.pressure_psi},
                        {"force_min_N", e.force_min_N},
                        {"force_max_N", e.force_max_N},
                        {"off_path_mm", e.off_path_mm}};
    const auto count = [&](const Counted& c) {
      return ordered_json{{"made", c.made}, {"full", c.full}, {"averaged", c.averaged}, {"missing", c.missing}};
    };
    out_["frame"] = count(rig.frame);
    out_["pressure"] = count(rig.pressure);
    out_["dropped"] = rig.dropped;
    out_["outcome"] = rig.host().last_outcome();
    if (rig.attempts > 0) {
      if (!rig.is_done()) find("ended as " + rig.host().last_outcome() + ": " + rig.host().last_fault());
      judge_recording(rig);
    }
    rig.rig().shut_down();
    const double grown_MB = number_of("end", "MB") - number_of("begin", "MB");
    // 2000 events of the host and the samples of a trip, 15 s of both streams, are kept at most.
    if (grown_MB > kMostGrowth_MB) find(base::formatted("memory grew by %.1f MB", grown_MB));
    if (number_of("end", "descriptors") > number_of("begin", "descriptors")) find("descriptors are left open");
    out_["findings"] = findings_;
    return out_;
  }

  [[nodiscard]] double number_of(const char* group, const char* key) const {
    return out_.contains(group) ? out_[group][key].get<double>() : 0.0;
  }

  void judge_recording(SoakedRig& rig) {
    const auto directory = rig.host().run_directory();
    Counts read;
    const auto report = messages::read_run(directory, read);
    if (report.state() != messages::RecordingState::kWhole) {
      find(std::string("the recording is ") + messages::to_text(report.state()) +
           (report.complaints().empty() ? "" : ": " + report.complaints().front()));
    }
    const auto compare = [&](const char* what, const Counted& c, std::uint64_t full, std::uint64_t averaged) {
      if (c.full != full || c.averaged != averaged)
        find(base::formatted("%s: read %llu + %llu, the recorder said %llu + %llu", what,
                             static_cast<unsigned long long>(full), static_cast<unsigned long long>(averaged),
                             static_cast<unsigned long long>(c.full), static_cast<unsigned long long>(c.averaged)));
    };
    compare("frame", rig.frame, read.frame_full, read.frame_averaged);
    compare("pressure", rig.pressure, read.pressure_full, read.pressure_averaged);
    account("frame", rig.frame, frame_silent_s_, rig);
    account("pressure", rig.pressure, pressure_silent_s_, rig);
    const daemon::Catalogue catalogue(options_.runs_root, daemon::Catalogue::Access::kReadOnly);
    const auto row = catalogue.find_run(rig.run_id);
    if (!row || row->state != "done" || row->sessions_done != static_cast<int>(plan_.sessions.size()))
      find("the catalogue does not have every session as done");
  }

  /// Recorded or counted as missing is what the plant made while a run was open. A run is opened, and closed, at a turn
  /// of the host, 50 ms apart. What a device whose link was dead when the run was closed held back is bounded by how
  /// long it was.
  void account(const char* what, const Counted& c, double silent_s, const SoakedRig& rig) {
    constexpr double kEdge = 60.0;
    const double edges = kEdge * rig.attempts;
    const double left = static_cast<double>(c.made) -
                        static_cast<double>(c.full + c.averaged + c.missing + rig.dropped + rig.lost_messages);
    out_[std::string(what) + "_not_arrived"] = left;
    if (left < -edges || left > edges + 1000.0 * silent_s)
      find(
          base::formatted("%s: %.0f samples are neither recorded nor counted; at most %.0f follow from links that were "
                          "dead for %.1f s",
                          what, left, edges + 1000.0 * silent_s, silent_s));
  }

  const PlayOptions options_;
  double frame_silent_s_ = 0.0, pressure_silent_s_ = 0.0;
  std::set<std::string> late_codes_;  ///< of the last strike, until it is used
  std::uint32_t late_until_step_ = 0;
  double repaired_s_ = 0.0;
  daemon::RigConfig config_;
  std::string protocol_;
  protocol::Plan plan_;
  std::vector<Strike> strikes_;
  ordered_json out_;
  std::vector<std::string> findings_;
};

}  // namespace

double resident_MB() {
  std::ifstream in("/proc/self/statm");
  double all = 0.0, resident = 0.0;
  in >> all >> resident;
  return resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1048576.0;
}

int open_descriptors() {
  int n = 0;
  for ([[maybe_unused]] const auto& each : std::filesystem::directory_iterator("/proc/self/fd")) ++n;
  return n - 1;  // the one that looks
}

ordered_json play(std::uint64_t seed, const PlayOptions& options) {
  return Play(seed, options).run();
}

}  // namespace isorig::soak
