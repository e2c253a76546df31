#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "identify/diagnose/verdict.hpp"

namespace isorig::identify {

/// A name that the diagnosis of a simulated recording gave.
struct Claim {
  std::string effect;
  double promised = 0.0;  ///< its weight, less what stays unexplained: what would be stated if weights were frequencies
  bool right = false;     ///< the recording was simulated with this effect
  bool refused = false;   ///< left-out readings speak against its law
};

/// A recording simulated from one of the explanations, diagnosed as if nothing were known of it.
struct Rehearsal {
  std::string truth;     ///< the explanation's key
  std::string withheld;  ///< the effect that the search was not given, so that it meets physics it does not know; or ""
  Verdict verdict = Verdict::kConsistent;
  std::vector<Claim> claims;
  std::string failed;  ///< why there is no diagnosis, or ""
};

/// By how much weights overstate: a claim that promises q is right with the frequency c q. Mean and 95 % interval of c
/// given what the claims of simulated recordings came to (reliability/sureness.hpp).
struct Sureness {
  double value = 0.0, low95 = 0.0, high95 = 1.0;
  std::size_t claims = 0, right = 0;
};

/// How often the claims of this diagnosis are right, by simulation of these very recordings (reliability/).
struct Reliability {
  std::vector<Rehearsal> rehearsals;
  /// Of claims beside nothing unknown, and beside unknown physics. None where too few claims were made.
  std::optional<Sureness> beside_nothing, beside_unknown;
};

}  // namespace isorig::identify
