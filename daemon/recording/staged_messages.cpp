#include "daemon/recording/staged_messages.hpp"

#include <algorithm>
#include <utility>

namespace isorig::daemon {

bool StagedMessages::goes_beyond(std::int32_t session) const noexcept {
  return std::any_of(staged_.begin(), staged_.end(), [&](const Staged& s) { return s.session > session; });
}

void StagedMessages::append_to(SegmentedLog& log) {
  std::stable_sort(staged_.begin(), staged_.end(), [](const Staged& a, const Staged& b) {
    return std::pair(a.session, a.mono_ns) < std::pair(b.session, b.mono_ns);
  });
  for (const auto& s : staged_) log.append(s.channel, s.session, s.mono_ns, {encoded_.data() + s.offset, s.size});
  staged_.clear();
  encoded_.clear();
}

}  // namespace isorig::daemon
