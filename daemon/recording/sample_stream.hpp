#pragma once
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <variant>

#include "daemon/core/records.hpp"

/// What the daemon writes to the subscribers of SOCKET.samples (docs/sample-stream.md): records, each a u32 length, a
/// u8 kind and a body of plain little-endian numbers. Written and read here alone.
namespace isorig::daemon::samples {

inline constexpr std::uint32_t kVersion = 1;
/// Of one record, length field included. The longest is an event with both texts full.
inline constexpr std::size_t kMaxRecordBytes = 1024;

enum class Kind : std::uint8_t { kHello, kFrame, kPressure, kControl, kEvent, kLost };

/// The first record of every connection.
struct Hello {
  std::uint32_t version = kVersion;
  std::int64_t epoch_unix_us = 0;  ///< Unix time at mono_ns = 0, as the daemon saw it at its start
  std::string rig;
};

/// Totals since this connection began; written before the next record that follows a loss.
struct Lost {
  std::uint64_t frame = 0;
  std::uint64_t pressure = 0;
  std::uint64_t control = 0;
  std::uint64_t events = 0;
  /// Records of any kind that the daemon's own queue lost since its start: nobody got them live. The recording has
  /// them.
  std::uint64_t before_the_socket = 0;

  friend bool operator==(const Lost&, const Lost&) = default;
};

/// Appends a record to `out`.
void append(std::string& out, const Hello& hello);
void append(std::string& out, const FrameRecord& record);
void append(std::string& out, const PressureRecord& record);
void append(std::string& out, const ControlRecord& record);
void append(std::string& out, const EventRecord& record);
void append(std::string& out, const Lost& lost);

/// The bytes are no sample stream, or one of another version; what() says which.
class StreamError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// Fields that do not travel (device time, raw values, `keep`) have their defaults.
using Record = std::variant<Hello, FrameRecord, PressureRecord, ControlRecord, EventRecord, Lost>;

/// Puts a stream of bytes together again, whatever pieces it comes in.
class Reader {
 public:
  void feed(std::string_view bytes);
  /// The next whole record; false: more bytes are needed. Kinds that this version does not know are passed over. Throws
  /// StreamError.
  bool next(Record& record);

 private:
  std::string buffer_;
  std::size_t at_ = 0;
  bool greeted_ = false;
};

}  // namespace isorig::daemon::samples
