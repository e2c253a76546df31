#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

/// The LCM channels and the size of their messages (messages/lcm/, docs/lcm-channels.md).
namespace isorig::messages {

enum class Channel : std::uint8_t {
  kHeader,           ///< run_header_t, recordings only
  kSession,          ///< session_mark_t, recordings only
  kFrame,            ///< frame_batch_t
  kPressure,         ///< pressure_batch_t
  kFrameAverage,     ///< frame_average_batch_t, recordings only
  kPressureAverage,  ///< pressure_average_batch_t, recordings only
  kState,            ///< control_batch_t
  kEvent,            ///< event_t
  kProgress,         ///< progress_t, live only
  kClock,            ///< exchange_batch_t
  kSync,             ///< sync_check_t
  kChain,            ///< chain_t, recordings only
};
inline constexpr std::size_t kChannels = 12;

inline constexpr std::array<std::string_view, kChannels> kChannelNames{
    "ISORIG_HEADER",   "ISORIG_SESSION",       "ISORIG_FRAME",
    "ISORIG_PRESSURE", "ISORIG_FRAME_AVERAGE", "ISORIG_PRESSURE_AVERAGE",
    "ISORIG_STATE",    "ISORIG_EVENT",         "ISORIG_PROGRESS",
    "ISORIG_CLOCK",    "ISORIG_SYNC",          "ISORIG_CHAIN"};

constexpr std::string_view name_of(Channel channel) {
  return kChannelNames[static_cast<std::size_t>(channel)];
}

/// Every live message fits into one Ethernet frame: a message that is split over several datagrams is lost
/// whole when one of them is. The batches are as large as that allows.
inline constexpr std::size_t kMaxMessageBytes = 1400;
inline constexpr std::int16_t kFrameBatch = 30;            // 42 B each
inline constexpr std::int16_t kPressureBatch = 36;         // 35 B each
inline constexpr std::int16_t kFrameAverageBatch = 10;     // 124 B each
inline constexpr std::int16_t kPressureAverageBatch = 14;  // 96 B each
inline constexpr std::int16_t kControlBatch = 17;          // 77 B each
inline constexpr std::int16_t kExchangeBatch = 40;         // 33 B each

inline constexpr std::string_view kLogFormatName = "isorig-log/";  // then the version
inline constexpr std::string_view kLogFormat = "isorig-log/2";
/// Without checksums and without ISORIG_CHAIN; still read.
inline constexpr std::string_view kOldLogFormat = "isorig-log/1";

}  // namespace isorig::messages
