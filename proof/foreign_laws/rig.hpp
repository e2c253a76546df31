#pragma once
#include <functional>
#include <optional>

#include "proof/foreign_laws/laws.hpp"
#include "proof/foreign_laws/path.hpp"
#include "proof/generator/rig.hpp"

/// The rig of the second generator: a specimen of springs and arms, and lists of laws at four places. It has no
/// feedback from force to motion, so each place is a map from signals to signals.
namespace isorig::proof::foreign {

struct Arm {
  double stiffness_N_mm = 0.0;
  double time_s = 1.0;
  std::function<Flow(double viscosity_N_s_mm)> flow;  ///< empty: linear
};

enum class Air { kStill, kDroop, kHunting, kLeak, kTrappedGas };
[[nodiscard]] std::string_view name_of(Air air);

struct Supply {
  Air air = Air::kDroop;
  double nominal_psi = 15.0;
  double swing_psi = 0.05;  ///< how far the pressure departs, about
  double time_s = 1.5;      ///< recovery, period, leak or heat exchange
};

struct Rig {
  double rest_length_mm = 90.0;
  double elongation_mm = 10.0;  ///< of the specimen at position 0
  double stiffness_N_mm = 2.0;
  std::vector<Arm> arms;
  double stroke_mm = 4.0;
  double peak_N = 25.0;
  Supply supply;

  std::vector<std::function<Signal(const Drive&)>> kinematics;  ///< new positions of the grip
  std::vector<std::function<Signal(const Drive&)>> specimen;    ///< forces beside spring and arms
  std::function<double(double specimen_N)> envelope;            ///< of all of the specimen's force; empty: none
  std::vector<std::function<Signal(const Drive&)>> fixture;     ///< forces driven by the crosshead itself
  std::vector<std::function<Signal(const Drive&, const Signal& force_N)>> sensor;
};

/// Signals of the rig on the path's own grid, before any instrument.
struct Played {
  Drive crosshead;  ///< the crosshead's positions, with the pressure
  Signal force_N;
};
[[nodiscard]] Played play(const Rig& rig, const Path& path);

/// The recorders start this long after the rig, when what is not at rest at first has settled.
inline constexpr double kSettling_s = 1.0;

struct FrameRates {
  double fast_Hz = 200.0;
  double slow_Hz = 5.0;
  double pressure_Hz = 10.0;
};
/// What perfect instruments would have read, at these rates.
[[nodiscard]] Trace read(const Played& played, const Path& path, const FrameRates& rates,
                         const std::vector<double>& jitter_s = {});
[[nodiscard]] std::vector<double> frame_times_s(const Path& path, const FrameRates& rates);

}  // namespace isorig::proof::foreign
