#pragma once
#include <functional>
#include <string>

#include "cli/campaign/piece.hpp"
#include "cli/campaign/signals.hpp"

namespace isorig::cli::pieces {

/// Which lines of a list are this process's: every `of`-th, from `task` on.
struct Share {
  std::size_t task = 0;
  std::size_t of = 1;
};

struct Done {
  std::size_t ended = 0;  ///< pieces looked at, made or failed
  std::size_t failed = 0;
  std::string last{};          ///< recording that ended last
  int stopped_by = 0;          ///< a signal; what was under way is not there
  std::string cannot_go_on{};  ///< why it stopped early: no room, or a model that was changed
};

/// Makes the pieces of the recordings in a list, `jobs` at a time, each in a process of its own. Memory does not grow
/// with the list. A signal ends those that are under way and returns. `ended` is called after each, from any thread,
/// one at a time; `meanwhile` four times a second from the caller's.
[[nodiscard]] Done make_pieces(Workshop shop, const std::filesystem::path& list, Share share, unsigned jobs,
                               const Signals& signals,
                               const std::function<void(const std::string& recording, const Attempt&)>& ended,
                               const std::function<void(const Done&)>& meanwhile);

}  // namespace isorig::cli::pieces
