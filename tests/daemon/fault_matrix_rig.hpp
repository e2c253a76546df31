#pragma once
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/toml_reader.hpp"
#include "daemon/recording/recorder.hpp"
#include "daemon/rig/virtual_rig.hpp"
#include "made_samples.hpp"
#include "pressure_ceiling.hpp"
#include "protocol/compile.hpp"
#include "recording_rig.hpp"
#include "struck_rig.hpp"

/// The rig that the fault matrix plays its cells on: the daemon's core, services and recorder on the simulated plant,
/// brought to a kind of step or a state, and measured by what the plant truly does.
namespace isorig::daemon::test {

/// What the rig is doing when a fault strikes: every kind of step of the language, and the states between them.
enum class At : unsigned {
  kReady,
  kArmed,
  kCountdown,
  kSetup,
  kJog,
  kApproach,
  kFill,
  kLower,
  kSettle,
  kHold,
  kSlow,
  kFast,
  kTriangle,
  kSine,
  kPaused,
  kSealed,
  kHeld,
  kStopping,
};
inline constexpr unsigned kSituations = 18;

struct Situation {
  At at;
  const char* name;
  const char* meaning;
  double speed_mm_s;  ///< of the crosshead when the fault strikes, 0: it stands
  bool has_run;       ///< a run is open, and recorded
  bool has_pressure;  ///< the loop regulates, or the valves are shut on a pressure
};
[[nodiscard]] const Situation& situation(At at);

/// Samples that a fault takes out of a recording, at most.
struct Losses {
  struct OfStream {
    double missing = 0.0;  ///< their numbers are: they are counted
    double unheard = 0.0;  ///< nobody can know how many they were
  };
  OfStream frame, pressure;
};

/// What the plant did, and what the daemon said, from the moment of the fault on.
struct Seen {
  double trip_s = -1.0;   ///< until the rig was faulted; negative: it was not
  double stood_s = 0.0;   ///< the crosshead stood from then on
  double vented_s = 0.0;  ///< and the true pressure was below strike()'s; the whole time watched: it was not
  double began_mm = 0.0;
  double tripped_psi = 0.0;  ///< the true pressure when the rig was faulted
  bool moved_at_trip = false;
  double position_min_mm = 0.0, position_max_mm = 0.0;
  double force_min_N = 0.0, force_max_N = 0.0;
  double pressure_max_psi = 0.0;
  double over_setpoint_psi = 0.0;  ///< over the one in force at that millisecond
  double watched_s = 0.0;
  std::string cause;                ///< code of the first fault after the strike
  std::vector<std::string> faults;  ///< all codes since, in their order
  std::vector<std::string> events;
  std::string not_ready;
  RunState state = RunState::kIdle;
};

class MatrixRig final : public StruckRig {
 public:
  static constexpr double kMoving_mm_s = 0.05;  ///< less is the crosshead's regulation
  static constexpr double kVented_psi = 1.0;

  explicit MatrixRig(At at);

  /// To where the fault is to strike. False: it did not get there; trouble() says why. `before_motion`: to just before
  /// the jog or the approach, which set_off() commands.
  bool bring(bool before_motion = false);
  bool set_off();
  /// Measures from now on; below `rest_psi` it counts as vented.
  void strike(double rest_psi = kVented_psi);
  void watch(double seconds);
  [[nodiscard]] Seen seen() const;

  /// After the fault is over: what docs/states.md says to do, until the rig is ready. False with trouble().
  bool come_back();
  /// A new start fills and runs. False with trouble().
  bool start_again();
  /// Ends the recording and reads it again. False with trouble(). `cause`: the code of an event that has to be in it,
  /// with the samples before it in full; empty: none. Every sample that the devices made is in it, but for `losses`.
  bool recording_is_intact(const std::string& cause, const Losses& losses);

  /// isorigd is gone: by SIGKILL; or by SIGTERM, with the rig at rest and its recording ended. Then nobody is there.
  void kill();
  bool terminate();
  /// Another is started on the same plant. seen() goes on from the strike.
  void start_daemon();
  /// What a run's recording looks like after kill(), at `kill_s`.
  bool is_left_interrupted(double kill_s);
  /// The run that was open goes on, and is ended. False with trouble().
  bool go_on();

  [[nodiscard]] double now_s() const noexcept { return static_cast<double>(rig_->now_ns()) * 1e-9; }
  [[nodiscard]] const std::string& trouble() const noexcept { return trouble_; }
  [[nodiscard]] VirtualRig& rig() noexcept override { return *rig_; }
  [[nodiscard]] Core& core() noexcept { return rig_->core(); }
  /// Of the recording that is open.
  [[nodiscard]] std::filesystem::path run_folder() const { return folder_->path() / "run"; }
  [[nodiscard]] const RigConfig& config() const noexcept { return config_; }
  Reply ask(Request::Verb verb, double target_mm = 0.0);
  void run_for(double seconds);
  template <typename Condition>
  bool run_until(double seconds, Condition condition) {
    const auto until = rig_->now_ns() + static_cast<std::int64_t>(seconds * 1e9);
    while (!condition()) {
      if (rig_->now_ns() >= until) return false;
      tick();
    }
    return true;
  }

 private:
  void tick();
  void look();
  void follow_setpoint();
  void drain();
  bool fail(const std::string& what);
  bool arm(const std::string& steps);  ///< where arming is required; empty: of the plan that there is
  bool begin(const std::string& steps);
  bool begin_again();  ///< the same steps, into the recording that there is
  bool give_start();
  bool reach(RunState state, double seconds);
  void open_recording();
  bool is_ended_in_order(testing::Collected& got, const Losses& losses, const testing::Collected& before);
  [[nodiscard]] std::string unaccounted(const RecorderStatus& told, const Losses& losses) const;
  bool evidence_is_kept(const testing::Collected& got, const std::string& cause);

  const Situation& where_;
  RigConfig config_;
  std::unique_ptr<VirtualRig> rig_;
  protocol::Plan plan_;
  std::unique_ptr<testing::TemporaryDirectory> folder_;
  std::unique_ptr<Recorder> recorder_;
  std::uint32_t last_id_ = 0;
  double opened_s_ = 0.0;  ///< the recording, first
  std::int64_t strike_ns_ = -1;
  double rest_psi_ = kVented_psi;
  std::int64_t trip_ns_ = -1, moved_ns_ = -1, pressed_ns_ = -1;
  RunState last_state_ = RunState::kIdle;
  std::vector<EventRecord> events_;
  PressureCeiling ceiling_;
  MadeSamples made_;
  Seen seen_;
  std::string trouble_;
};

}  // namespace isorig::daemon::test
