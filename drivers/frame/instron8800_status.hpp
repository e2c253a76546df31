#pragma once

namespace isorig::frame {

/// Codes in bits 9 to 12 of the status word (Q22) that the driver decides by.
inline constexpr unsigned kInstron8800TravelLimit = 1, kInstron8800EmergencyStop = 6;

/// What such a code says; nullptr when all is well. As ISIS' EPICS support reads them.
[[nodiscard]] const char* describe_instron8800_status(unsigned code) noexcept;

}  // namespace isorig::frame
