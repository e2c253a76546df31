#include "daemon/export/zlib_stream.hpp"

#include <isa-l/igzip_lib.h>

#include <array>
#include <limits>
#include <stdexcept>

namespace isorig::daemon {

struct ZlibStream::State {
  isal_zstream stream{};
  std::array<std::uint8_t, ISAL_DEF_LVL1_DEFAULT> level_buffer{};
  std::array<std::uint8_t, 64 * 1024> out{};

  void begin() {
    isal_deflate_init(&stream);
    stream.level = 1;
    stream.level_buf = level_buffer.data();
    stream.level_buf_size = static_cast<std::uint32_t>(level_buffer.size());
    stream.gzip_flag = IGZIP_ZLIB;
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
  auto& stream = state_->stream;
  stream.next_in = const_cast<std::uint8_t*>(bytes.data());  // ISA-L only reads it
  stream.avail_in = static_cast<std::uint32_t>(bytes.size());
  stream.end_of_stream = last ? 1 : 0;
  do {
    stream.next_out = state_->out.data();
    stream.avail_out = static_cast<std::uint32_t>(state_->out.size());
    if (isal_deflate(&stream) != COMP_OK) throw std::logic_error("ISA-L refused to compress");
    const auto made = state_->out.size() - stream.avail_out;
    if (made > 0) sink({state_->out.data(), made});
  } while (stream.avail_out == 0);  // room left: nothing waits to come out
  if (last) state_->begin();
}

}  // namespace isorig::daemon
