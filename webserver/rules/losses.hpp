#pragma once
#include <cstdint>
#include <optional>

namespace isorig::web {

/// Records that never reached this process, each counted once, over all connections to the daemon. Asks for no time and
/// does no I/O.
class Losses {
 public:
  /// As the daemon tells them, totals of this connection but for the last (docs/sample-stream.md).
  struct Told {
    std::uint64_t samples = 0;            ///< of frame and pressure, which are numbered: they are gaps as well
    std::uint64_t others = 0;             ///< control records and events
    std::uint64_t before_the_socket = 0;  ///< of any kind, since the daemon's start
  };

  void connected();
  void told(const Told& totals);
  /// Any other record: what was lost before the socket from now on was lost for this connection.
  void record();

  /// What the daemon counted between itself and here.
  [[nodiscard]] std::uint64_t on_the_way() const { return numbered() + others_before_ + told_.others; }
  /// All, with `gaps` of the devices' numbers. A gap may be what the daemon has counted, too, and what was lost before
  /// the socket may be of any kind: the greater of both is what is certain to be missing.
  [[nodiscard]] std::uint64_t all(std::uint64_t gaps) const;

 private:
  [[nodiscard]] std::uint64_t numbered() const;

  Told told_;
  std::optional<std::uint64_t> base_;                      // before the socket, when this connection began
  std::uint64_t numbered_before_ = 0, others_before_ = 0;  // of the connections that ended
};

}  // namespace isorig::web
