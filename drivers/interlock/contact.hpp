#pragma once
#include <cstdint>

namespace isorig::interlock {

/// One contact of a safety circuit, debounced one way only: an opening acts at once, a closing only after the
/// contact stayed closed for `closing_ns`. A contact that bounces, chatters or is barely made is open.
class Contact {
 public:
  explicit Contact(std::int64_t closing_ns) noexcept : closing_ns_(closing_ns) {}

  /// An edge that the kernel saw. Two closings in a row have an opening between them that was too short to be
  /// seen, or was lost: that counts as one.
  void edge(bool closed, std::int64_t mono_ns) noexcept {
    if (!closed || is_made_) open(mono_ns);
    if (closed) make(mono_ns);
  }

  /// What the line reads after the edges before it were taken. Another level than the last edge left means that
  /// edges were lost: true, and the level is what counts.
  bool level(bool closed, std::int64_t mono_ns) noexcept {
    const bool differs = is_known_ && closed != is_made_;
    if (!is_known_ || differs) {
      if (closed)
        make(mono_ns);
      else
        open(mono_ns);
    }
    is_known_ = true;
    return differs;
  }

  /// Anything may have happened unseen: it has to prove itself anew.
  void restart() noexcept {
    is_known_ = is_made_ = false;
    opened_ns_ = 0;
  }

  [[nodiscard]] bool closed(std::int64_t now_ns) const noexcept { return is_made_ && now_ns - made_ns_ >= closing_ns_; }
  /// When it last opened; 0 when it was never seen to.
  [[nodiscard]] std::int64_t opened_ns() const noexcept { return opened_ns_; }
  [[nodiscard]] std::uint32_t openings() const noexcept { return openings_; }

 private:
  void open(std::int64_t mono_ns) noexcept {
    if (is_made_ || !is_known_) ++openings_, opened_ns_ = mono_ns;
    is_made_ = false;
    is_known_ = true;
  }
  void make(std::int64_t mono_ns) noexcept {
    made_ns_ = mono_ns;
    is_made_ = is_known_ = true;
  }

  std::int64_t closing_ns_;
  bool is_known_ = false;
  bool is_made_ = false;
  std::int64_t made_ns_ = 0;
  std::int64_t opened_ns_ = 0;
  std::uint32_t openings_ = 0;
};

}  // namespace isorig::interlock
