#pragma once
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "cli/rig/client.hpp"

/// What calibrate and selftest do with a rig at rest, through the daemon's API.
namespace isorig::cli {

/// One line from the terminal; nothing at its end.
[[nodiscard]] std::optional<std::string> ask(const std::string& question);
/// True with --yes, or when the operator says y; without a terminal a refusal that says so.
[[nodiscard]] bool consent(const std::string& question, bool yes);
/// First line that a shell command prints. Throws when it fails.
[[nodiscard]] std::string output_of(const std::string& command);

/// The operator pressed Ctrl-C, or somebody ended this program, while a HeldPressure was there.
struct Interrupted : std::runtime_error {
  Interrupted() : std::runtime_error("interrupted: the rig vents") {}
};
/// Sleeps; throws Interrupted.
void pause_for(double seconds);

struct Settling {
  double window_s = 2.0;
  double settle_s = 30.0;
  double drift_max = 0.0;  ///< over the window, in the channel's unit
};

struct SettledReading {
  double raw = 0.0, calibrated = 0.0, standard_error = 0.0, sd = 0.0, drift = 0.0, temperature_C = 0.0;
};

/// Mean of `channel` ("pressure", "force", "position") over a window that began after the call. Throws
/// std::runtime_error when it does not settle, with how far it moves, or when there is no reading.
[[nodiscard]] SettledReading settled_reading(const Client& client, const std::string& channel,
                                             const Settling& settling);

/// Takes the rig from one pressure to the next and holds each until the next is asked for. 0 is the vented rig,
/// whatever its sensor shows; between two of those the pressures are one run of the daemon's. The crosshead stays where
/// it is. However it is left, the rig vents.
class HeldPressure {
 public:
  HeldPressure(const Client& client, std::vector<double> pressures_psi, const std::string& operator_name);
  ~HeldPressure();
  HeldPressure(const HeldPressure&) = delete;
  HeldPressure& operator=(const HeldPressure&) = delete;
  /// Names of the runs, the evidence.
  [[nodiscard]] const std::string& runs() const noexcept { return runs_; }
  /// To the `index`-th pressure; returns when the run stands there, paused, the pressure held.
  void go_to(std::size_t index);

 private:
  void start(std::size_t index);
  [[nodiscard]] double time_out_s(std::size_t index) const;
  std::optional<Answer> confirm();
  void vent() noexcept;

  const Client& client_;
  std::vector<double> pressures_psi_;
  std::string operator_name_;
  std::string runs_;
  double rate_psi_s_ = 0.0;
  bool open_ = false;
  std::size_t first_ = 0;  // index of the present run's first pressure
};

/// Until the rig is idle or ready.
void wait_for_rest(const Client& client, double seconds);

}  // namespace isorig::cli
