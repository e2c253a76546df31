#pragma once

/// What `isorig` returns to the shell (docs/protocol.md lists them for users). Stable: scripts rely on them.
namespace isorig::cli {

enum ExitCode : int {
  kOk = 0,
  kFailure = 1,   ///< it was tried and did not work; the message says why
  kUsage = 2,     ///< the command line is wrong
  kBadInput = 3,  ///< a file is wrong: protocol, rig, recording, model; each fault with file:line:column
  kNoDaemon = 4,  ///< isorigd does not answer on its socket
  kRefused = 5,   ///< isorigd answers and says no (wrong state, no interlock, limits)
  kTripped = 6,   ///< a limit or a fault stopped the run; it may be held under pressure
  kDataLost = 7,  ///< it worked, but samples are missing; the message says how many and where
};

}  // namespace isorig::cli
