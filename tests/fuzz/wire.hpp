#pragma once
#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "drivers/api/frame.hpp"
#include "drivers/clock/real_clock.hpp"
#include "target.hpp"

/// A device on the wire without a wire. The drivers' connect_tcp(), open_serial() and RealClock are those of wire.cpp,
/// and so are read(), write(), ppoll() and the like for its descriptor: a connection is two strings in this process,
/// whenever the driver waits for an answer the peer is asked for one, and time is what was waited for. One thread, no
/// call of the kernel, no real time, the same input does the same again.
namespace isorig::fuzz {

class Peer {
 public:
  virtual ~Peer() = default;
  /// What the driver has written; what the device sends back, nothing if it keeps silent.
  virtual std::string answer(std::string_view written) = 0;
  /// The device closes its end now.
  [[nodiscard]] virtual bool closes() { return false; }
  /// The driver waited for so long and nothing came.
  virtual void waited(std::int64_t timeout_ns) = 0;
};

/// The peer of every connection that is opened while it lives.
class OnTheWire {
 public:
  explicit OnTheWire(Peer& peer);
  ~OnTheWire();
  OnTheWire(const OnTheWire&) = delete;
  OnTheWire& operator=(const OnTheWire&) = delete;
};

/// How much is asked of a device in each of its up to four connections, and how seldom that is more than a poll: one
/// kind of act in `kinds` is a segment, one a stop, one a heartbeat.
struct Use {
  int acts = 0;
  int kinds = 0;
};
/// Connects a frame, does with it what the input says, and disconnects it, until the input ends.
void use(Input& in, frame::Device& device, std::span<frame::Sample> samples, const Use& how);

/// Likewise for any device: `acts` acts at most in each of its up to four connections.
struct Device {
  std::function<void()> connect, disconnect;
  std::function<void(int number)> act;
};
void use(Input& in, const Device& device, int acts);

}  // namespace isorig::fuzz
