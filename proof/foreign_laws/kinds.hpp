#pragma once
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "proof/foreign_laws/rig.hpp"

namespace isorig::proof::foreign {

using Shape = std::map<std::string, double>;

/// One law to conceal. Its strength is one number in units of the rig (share of the peak force, of the stroke, ...);
/// everything else is its shape and is drawn with the case.
struct Kind {
  std::string_view law;
  std::string_view effect;            ///< the catalogue's name, or "unknown"
  std::vector<std::string> accepted;  ///< further names that are the same thing as far as a recording can tell
  std::string_view acts_on;
  std::vector<std::string> depends_on;  ///< direction, rate, strain, ... as in the recording format
  std::string_view source;
  std::string_view strength_is;
  double start = 0.02;  ///< where the search for a size begins
  double most = 0.5;    ///< what a rig could have at the utmost
  Shape (*draw)(Random& random, const Rig& rig, const Path& train) = nullptr;
  void (*conceal)(double strength, const Shape& shape, Rig& rig) = nullptr;
  bool one_session = false;  ///< an event, or a path of chance: nothing can predict it in another session
  /// A number of the shape whose own effect stays where the strength goes to 0. It is halved until it is the smaller
  /// part of what is concealed: a play of a millionth of the stroke that follows with 10 ms is a lag, and no play.
  std::string_view stays = {};
};

inline constexpr std::string_view kUnknown = "unknown";

[[nodiscard]] std::span<const Kind> kinds();
[[nodiscard]] const Kind& kind_of_law(std::string_view law);

}  // namespace isorig::proof::foreign
