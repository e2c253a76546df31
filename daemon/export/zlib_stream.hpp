#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>

namespace isorig::daemon {

/// A zlib stream (RFC 1950) that ISA-L writes, at its level 1: `docs/performance.md` says what zlib itself would cost.
/// The same bytes in every process of one machine. Two kinds of processor may write different ones, which say the same.
class ZlibStream {
 public:
  using Sink = std::function<void(std::span<const std::uint8_t>)>;

  ZlibStream();
  ~ZlibStream();
  ZlibStream(const ZlibStream&) = delete;
  ZlibStream& operator=(const ZlibStream&) = delete;

  /// `sink` gets what is ready, in pieces; all of it after the `last` bytes, and the next ones begin another stream.
  /// At most 4 GiB at once.
  void add(std::span<const std::uint8_t> bytes, bool last, const Sink& sink);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace isorig::daemon
