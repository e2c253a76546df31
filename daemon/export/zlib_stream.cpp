#include "daemon/export/zlib_stream.hpp"

#include <isa-l/igzip_lib.h>

#include <algorithm>
#include <array>
#include <limits>
#include <stdexcept>

namespace isorig::daemon {
namespace {

/// ISA-L 2.30 treats the first byte of a stream apart, in two routines. That of long inputs
/// (`write_first_byte` of `igzip_icf_body_h1_gr_bt.asm`) should hash the four bytes from the third on and hashes bits
/// 16 to 47 of the stream's address instead. Once in some thousand streams the two hashes agree, and then another match
/// is found: the output depended on where the memory lay. The routine of short inputs has no such fault; a flush behind
/// the first four bytes, which are the fewest that it hashes, begins each stream with it.
constexpr std::size_t kFlushedBytes = 4;

}  // namespace

struct ZlibStream::State {
  isal_zstream stream{};
  std::array<std::uint8_t, ISAL_DEF_LVL1_DEFAULT> level_buffer{};
  std::array<std::uint8_t, 64 * 1024> out{};
  std::array<std::uint8_t, kFlushedBytes> first{};
  std::size_t first_size = 0;

  void begin() {
    first_size = 0;
    isal_deflate_init(&stream);
    stream.level = 1;
    stream.level_buf = level_buffer.data();
    stream.level_buf_size = static_cast<std::uint32_t>(level_buffer.size());
    stream.gzip_flag = IGZIP_ZLIB;
  }

  void compress(std::span<const std::uint8_t> bytes, std::uint16_t flush, const Sink& sink) {
    stream.next_in = const_cast<std::uint8_t*>(bytes.data());  // ISA-L only reads it
    stream.avail_in = static_cast<std::uint32_t>(bytes.size());
    stream.flush = flush;
    do {
      stream.next_out = out.data();
      stream.avail_out = static_cast<std::uint32_t>(out.size());
      if (isal_deflate(&stream) != COMP_OK) throw std::logic_error("ISA-L refused to compress");
      const auto made = out.size() - stream.avail_out;
      if (made > 0) sink({out.data(), made});
    } while (stream.avail_out == 0);  // room left: nothing waits to come out
  }

  void finish(std::span<const std::uint8_t> bytes, const Sink& sink) {
    stream.end_of_stream = 1;
    compress(bytes, NO_FLUSH, sink);
    begin();
  }
};

ZlibStream::ZlibStream() : state_(std::make_unique<State>()) {
  state_->begin();
}

ZlibStream::~ZlibStream() = default;

void ZlibStream::add(std::span<const std::uint8_t> bytes, bool last, const Sink& sink) {
  if (bytes.size() > std::numeric_limits<std::uint32_t>::max()) {
    throw std::invalid_argument("more than 4 GiB to be compressed at once");
  }
  auto& first = state_->first;
  auto& size = state_->first_size;
  if (size < first.size()) {
    const auto taken = std::min(first.size() - size, bytes.size());
    std::copy_n(bytes.begin(), taken, first.begin() + static_cast<std::ptrdiff_t>(size));
    size += taken;
    bytes = bytes.subspan(taken);
    if (last && bytes.empty()) return state_->finish({first.data(), size}, sink);
    if (size < first.size()) return;
    state_->compress(first, SYNC_FLUSH, sink);
  }
  if (last) return state_->finish(bytes, sink);
  state_->compress(bytes, NO_FLUSH, sink);
}

}  // namespace isorig::daemon
