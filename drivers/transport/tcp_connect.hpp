#pragma once
#include <cstdint>
#include <string>

namespace isorig::drivers {

/// A connected socket without Nagle's delay, not blocking, at the first of the host's addresses that answers within
/// `timeout_ms` each. Throws DeviceError (kDisconnected) that says which address failed how and what to look at; `name`
/// begins it ("frame at tcp 10.0.0.5:502").
[[nodiscard]] int connect_tcp(const std::string& host, std::uint16_t port, int timeout_ms, const std::string& name);

}  // namespace isorig::drivers
