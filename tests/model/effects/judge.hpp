#pragma once
#include <functional>
#include <iosfwd>
#include <ostream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "model/catalogue.hpp"
#include "model/composed.hpp"
#include "track.hpp"

namespace isorig::test {

using Numbers = std::span<const double>;
using Curve = std::vector<double>;   ///< one value per grid point of a track
using Columns = std::vector<Curve>;  ///< one curve per coefficient

/// A law written a second time, straight from its formula: Runge-Kutta with small steps, memory rules of
/// Masing and Madelung, closed forms. Exactly one of the three functions is set.
struct Judge {
  std::function<void(Numbers, Track&)> move = {};
  std::function<Columns(Numbers, const Track&)> force = {};
  std::function<Curve(Numbers, const Track&, const Curve&)> shape = {};
};

/// A law with numbers to try it with, and what it claims.
struct Case {
  std::string_view physics;
  std::string_view law;
  std::vector<std::vector<double>> parameters;  ///< sets to try
  std::vector<double> coefficients;
  /// Largest error on straight strokes that end on the instants, as a share of the peak force.
  double straight_error = 1e-6;
  /// On a smooth motion the error falls with this power of the step; 0: no error at any step.
  double order = 2;
  bool rate_independent = false;  ///< the same places at twice the speed give the same force
  bool passive = false;           ///< never gives back more work than it was given
  /// False: the law is driven by an acceleration that runs straight between instants, which at a corner it does not.
  bool knows_corners = true;
};

inline void PrintTo(const Case& c, std::ostream* out) {
  *out << c.physics << ", " << c.law;
}

/// Null when nobody wrote one: the tests then fail for that law.
[[nodiscard]] const Judge* judge_of(std::string_view physics, std::string_view law);
[[nodiscard]] const std::vector<Case>& cases();
[[nodiscard]] const Case* case_of(std::string_view physics, std::string_view law);

/// Every law of the elements and of the effects, by name.
struct Named {
  const model::Physics* physics;
  const model::Law* law;
};
[[nodiscard]] std::vector<Named> every_law();
[[nodiscard]] std::string test_name(const Named& named);
void PrintTo(const Named& named, std::ostream* out);

/// The case's part; behind a spring and a Maxwell arm when the law acts on motion or on force and has nothing
/// of its own to show.
[[nodiscard]] model::ModelSpec model_of(const Case& each, Numbers parameters);
/// A table with bends in it, for the laws that are tables.
[[nodiscard]] model::Table some_table();

/// The force of a model by the judges alone, in the order of docs/effects.md: kinematics, specimen, slack,
/// rig, lag, delay, sensor.
[[nodiscard]] Curve judged_force(const model::ModelSpec& spec, Track track);

}  // namespace isorig::test
