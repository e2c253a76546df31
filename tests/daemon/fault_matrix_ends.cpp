#include <algorithm>
#include <filesystem>

#include "fault_matrix_rig.hpp"

/// MatrixRig: isorigd ends, by a signal that it hears or by one that it does not, and another is started.
namespace isorig::daemon::test {
namespace {

using Verb = Request::Verb;

// Daemon::Impl::rest_patience(): the longest venting, and 2 s for an answer.
constexpr double kRestPatience_s = 22.0;

}  // namespace

/// What the process had written is in the files; what it had still in memory is not. The kernel lets go of its lines:
/// the dump valve opens. Nothing is said to frame and Teensy.
void MatrixRig::kill() {
  if (recorder_) {
    const auto folder = folder_->path() / "run", left = folder_->path() / "left";
    std::filesystem::copy(folder, left, std::filesystem::copy_options::recursive);
    recorder_.reset();
    std::filesystem::remove_all(folder);
    std::filesystem::rename(left, folder);
  }
  plant().interlock().hold_pressure(false);
  rig_->hang_all = true;
}

/// The way out of daemon.cpp: abort, wait for the rest, leave the devices, end the recording.
bool MatrixRig::terminate() {
  core().request_abort();
  run_for(0.02);  // two control records later the status shows the abort
  if (!run_until(kRestPatience_s, [&] { return core().status().stopped; })) return fail("was not seen at rest");
  drain();
  rig_->before_core = [this](VirtualRig& rig) {
    made_.look(rig, recorder_ != nullptr);
    look();
  };
  const bool stood = rig_->shut_down();
  rig_->before_core = nullptr;
  if (!stood) return fail("left the frame without having seen it stand");
  rig_->hang_all = true;
  testing::Collected got;
  if (!recorder_) return true;
  if (!is_ended_in_order(got, {}, {})) return false;
  const auto tells_end = [](const isorig_msgs::event_t& e) {
    return e.code == "run.aborted" || e.code == "run.not_started";
  };
  return std::any_of(got.events.begin(), got.events.end(), tells_end) || fail("the recording has no end of the run");
}

/// With the zero of a frame that counts from its last start: a new isorigd cannot know whether it was restarted.
void MatrixRig::start_daemon() {
  config_.core.frame_zero = FrameZero::kConfirm;
  rig_ = std::make_unique<VirtualRig>(config_, std::move(*rig_));
}

bool MatrixRig::is_left_interrupted(double kill_s) {
  testing::Collected got;
  const auto report = messages::read_run(run_folder(), got);
  if (report.state() != messages::RecordingState::kInterrupted)
    return fail(std::string("the recording was left ") + messages::to_text(report.state()));
  std::int64_t newest_ns = -1;
  for (const auto& f : got.frames) newest_ns = std::max(newest_ns, f.mono_ns);
  for (const auto& i : got.frame_intervals) newest_ns = std::max(newest_ns, i.last_ns);
  // docs/data.md, what a crash costs; and the recorder comes round every 20 ms, the frame is asked every 5.
  const RecorderOptions options;
  const double bound_s = options.sync_interval_s + options.lag_s + 0.1 + plan_.recording.before_s + 0.025;
  const double due_s = kill_s - bound_s;
  const double newest_s = static_cast<double>(newest_ns) * 1e-9;
  if (opened_s_ < due_s && newest_s < due_s)
    return fail("the newest sample is " + std::to_string(kill_s - newest_s) + " s older than the kill");
  return true;
}

/// As `isorig resume`: a further attempt in the same folder, from the start of the interrupted repetition.
bool MatrixRig::go_on() {
  testing::Collected before, after;
  messages::read_run(run_folder(), before);
  made_ = {};
  if (!begin_again()) return false;
  if (recorder_->attempt() != 2) return fail("the run does not go on");
  if (!run_until(60.0, [&] { return core().state() == RunState::kRunning && plant().truth().pressure_psi > 5.0; }))
    return fail("the run that goes on does not fill");
  if (const auto reply = ask(Verb::kAbort); !reply.accepted) return fail(reply.text);
  if (!reach(RunState::kReady, 30.0)) return false;
  run_for(3.0);
  if (!is_ended_in_order(after, {}, before)) return false;
  const auto is_kept = [](const testing::Collected::Sample& a, const testing::Collected::Sample& b) {
    return a.mono_ns == b.mono_ns && a.sequence == b.sequence && a.value == b.value && a.other == b.other;
  };
  if (after.frames.size() < before.frames.size() ||
      !std::equal(before.frames.begin(), before.frames.end(), after.frames.begin(), is_kept))
    return fail("what was recorded before is not as it was");
  if (after.frame_intervals.size() + after.frames.size() <= before.frame_intervals.size() + before.frames.size())
    return fail("nothing was added to what was recorded before");
  return true;
}

}  // namespace isorig::daemon::test
